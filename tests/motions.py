"""Motions with exact velocities, of every kind of body that is written to a file."""

import numpy as np
from numpy.typing import NDArray

Sample = tuple[NDArray[np.float64], NDArray[np.float64]]


def waving_strands(time: float, nodes: tuple[int, int] = (9, 4), length: float = 0.5) -> Sample:
    """Strands that stand on the x axis and sway along y, the more the higher, each a little later than the last."""
    s, root = np.meshgrid(np.linspace(0.0, 1.0, nodes[0]), 0.05 * np.arange(nodes[1]), indexing="ij")
    phase = 5.0 * time - 3.0 * s - 4.0 * root
    sway = 0.3 * length * s**2
    positions = np.stack([root, sway * np.sin(phase), length * s], axis=-1)
    return positions, np.stack([0 * s, 5.0 * sway * np.cos(phase), 0 * s], axis=-1)


def turning_loops(time: float, nodes: tuple[int, int] = (12, 2), radius: float = 0.3) -> Sample:
    """Closed strands, one above the other, that turn about their common axis and are no circles."""
    angle, level = np.meshgrid(2.0 * np.pi * np.arange(nodes[0]) / nodes[0], np.arange(nodes[1]), indexing="ij")
    reach = radius * (1.0 + 0.2 * np.cos(3.0 * angle))
    turned = angle + 2.0 * time
    positions = np.stack([reach * np.cos(turned), reach * np.sin(turned), 0.1 * level], axis=-1)
    return positions, 2.0 * np.stack([-positions[..., 1], positions[..., 0], 0 * reach], axis=-1)


def shearing_block(
    time: float, nodes: tuple[int, int, int] = (5, 4, 3), size: tuple[float, float, float] = (0.6, 0.4, 0.3)
) -> Sample:
    """A block on the ground whose upper nodes run ahead along x and that twists a little as it does."""
    u, v, w = np.meshgrid(*(np.linspace(0.0, 1.0, n) for n in nodes), indexing="ij")
    x, y, z = (length * part for length, part in zip(size, (u - 0.5, v - 0.5, w), strict=True))
    shift, rate = 0.6 * np.sin(4.0 * time), 2.4 * np.cos(4.0 * time)
    twist = shift * w
    c, s = np.cos(twist), np.sin(twist)
    positions = np.stack([c * x - s * y + shift * z, s * x + c * y, z], axis=-1)
    spin = rate * w
    return positions, np.stack([spin * (-s * x - c * y) + rate * z, spin * (c * x - s * y), 0 * z], axis=-1)


def breathing_torus(
    time: float, nodes: tuple[int, ...] = (16, 10), radius: float = 0.5, tube: float = 0.2, core: float = 0.4
) -> Sample:
    """A torus whose tube swells and shrinks: a surface with r_u x r_v outside, or a solid around a hollow core.

    Args:
        time: Time, s.
        nodes: Nodes around the ring, around the tube and, of a solid, from the core outwards.
        radius: Radius of the ring, m.
        tube: Radius of the tube, m.
        core: Radius of a solid's core, of that of the tube.
    """
    angles = [2.0 * np.pi * np.arange(n) / n for n in nodes[:2]]
    u, v, share = np.meshgrid(*angles, np.linspace(core, 1.0, nodes[2]) if len(nodes) > 2 else 1.0, indexing="ij")
    along = np.stack([np.cos(u), np.sin(u), 0 * u], axis=-1)
    out = np.cos(v)[..., None] * along + np.sin(v)[..., None] * np.array([0.0, 0.0, 1.0])
    swelling, rate = 1.0 + 0.3 * np.sin(6.0 * time), 1.8 * np.cos(6.0 * time)
    reach = (tube * share)[..., None] * out
    return (radius * along + swelling * reach).reshape(*nodes, 3), (rate * reach).reshape(*nodes, 3)


def squashed_ball(time: float, nodes: tuple[int, int] = (9, 14), radius: float = 0.3) -> Sample:
    """A ball of latitudes (u, half a step from the poles) and longitudes (v, wrapped) that bounces flat and tall."""
    u = np.pi * (np.arange(nodes[0]) + 0.5) / nodes[0]
    u, v = np.meshgrid(u, 2.0 * np.pi * np.arange(nodes[1]) / nodes[1], indexing="ij")
    ball = radius * np.stack([np.sin(u) * np.cos(v), np.sin(u) * np.sin(v), np.cos(u)], axis=-1)
    stretch = np.array([-0.1, -0.1, 0.25]) * np.sin(7.0 * time)
    return ball * (1.0 + stretch), ball * np.array([-0.7, -0.7, 1.75]) * np.cos(7.0 * time)
