"""Arrays of numbers from files: NumPy's own formats, tables, and grey pictures."""

import re
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from warpdeform.errors import InputError, Mistake, shown

Array = NDArray[np.float64]

TABLES = (".npy", ".npz", ".csv")
"""Suffixes of files that hold numbers as they are."""
PICTURES = (".pgm",)
"""Suffixes of pictures, whose numbers run from 0 (black) to 1 (white)."""

_HEADER = re.compile(rb"\A(P[25])((?:\s+|#[^\n]*\n)+\d+){3}\s", re.ASCII)


def read_array(path: Path, key: str, name: str, formats: str) -> Array:
    """The array of a .npy, .npz or .csv file, whatever its shape.

    Args:
        path: The file.
        key: What messages call the path.
        name: Name of the array in an .npz.
        formats: What may be used instead, as a sentence.

    Raises:
        InputError: A missing or unreadable file.
    """
    if path.suffix not in TABLES:
        raise InputError(Mistake(key, str(path), f'has the unknown suffix "{path.suffix}"', formats))
    try:
        if path.suffix == ".csv":
            table = np.genfromtxt(path, delimiter=",", dtype=np.float64, comments="#", ndmin=2)
            return table[1:] if np.isnan(table[0]).all() else table
        loaded = np.load(path, allow_pickle=False)
        return np.asarray(loaded[name] if path.suffix == ".npz" else loaded, dtype=np.float64)
    except FileNotFoundError:
        raise InputError(Mistake(key, str(path), "does not exist", "Check the path.")) from None
    except KeyError:
        raise InputError(Mistake(key, str(path), f'has no array "{name}"', f'Save it as "{name}".')) from None
    except (OSError, ValueError, EOFError, BadZipFile) as error:
        raise InputError(Mistake(key, str(path), f"cannot be read ({shown(error)})", formats)) from None


def read_picture(path: Path, key: str, formats: str) -> Array:
    """The pixels of a .pgm file (P2 or P5, 8 or 16 bits) from 0 to 1, row by row from the top.

    Args:
        path: The file.
        key: What messages call the path.
        formats: What may be used instead, as a sentence.

    Raises:
        InputError: A missing or unreadable file.
    """
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise InputError(Mistake(key, str(path), "does not exist", "Check the path.")) from None
    except OSError as error:
        raise InputError(Mistake(key, str(path), f"cannot be read ({error.strerror})", formats)) from None
    header = _HEADER.match(data)
    if header is None:
        raise InputError(Mistake(key, str(path), "is no grey picture in the format P2 or P5", formats))
    width, height, white = (int(n) for n in re.sub(rb"#[^\n]*\n", b" ", header[0]).split()[1:])
    count, body = width * height, data[header.end() :]
    problem = f"does not hold {width} x {height} grey values from 0 to {white}"
    try:
        if header[1] == b"P2":
            pixels = np.array(re.sub(rb"#[^\n]*\n", b" ", body).split()[:count], dtype=np.float64)
        else:
            pixels = np.frombuffer(body, np.uint8 if white < 256 else np.dtype(">u2"), count=count).astype(np.float64)
    except ValueError:
        raise InputError(Mistake(key, str(path), problem, formats)) from None
    if len(pixels) != count or count == 0 or not 0 < white < 65536 or pixels.max() > white or pixels.min() < 0:
        raise InputError(Mistake(key, str(path), problem, formats))
    return pixels.reshape(height, width) / white
