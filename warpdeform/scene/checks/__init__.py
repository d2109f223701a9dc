"""What must be true of the packaged scenes, as the tests see them after the last frame."""

from warpdeform.scene.checks import contact, curves, solids, surfaces
from warpdeform.scene.checks.claims import Check, Claim, History

__all__ = ["CHECKS", "Claim", "History"]

CHECKS: dict[str, Check] = {
    check.__name__: check
    for check in (
        surfaces.hanging,
        surfaces.flag,
        surfaces.carpet,
        surfaces.bunny,
        surfaces.materials,
        surfaces.lifted_patch,
        surfaces.spring_steel,
        surfaces.shrink_wrap,
        surfaces.balloon,
        curves.coiled_cord,
        curves.grass,
        curves.curtain,
        solids.jelly_cube,
        solids.ball_on_solid,
        contact.crumple,
        contact.twist,
        contact.layers,
    )
}
"""The check of each packaged scene, by the scene's name."""
