"""Where studies put what they find: a CSV that grows row by row, a JSON file, a picture."""

import csv
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from warpdeform.errors import InputError, Mistake


@dataclass(frozen=True)
class StudyFiles:
    """The files of a study, of one name but for their endings; a study that is stopped leaves the rows until then.

    Attributes:
        folder: Where they lie.
        name: Their name without an ending.
    """

    folder: Path
    name: str

    def __post_init__(self) -> None:
        if not self.folder.is_dir():
            raise InputError(Mistake("--out", str(self.folder), "is no folder", "Make it first."))

    def path(self, ending: str) -> Path:
        """The file with that ending."""
        return self.folder / f"{self.name}{ending}"

    def start_rows(self, header: Sequence[str]) -> None:
        """A CSV with nothing but its header."""
        self.path(".csv").write_text(",".join(header) + "\n", encoding="utf-8")

    def add_row(self, row: Mapping[str, Any]) -> None:
        """One more row, on disk at once."""
        with self.path(".csv").open("a", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerow([_cell(value) for value in row.values()])

    def write_json(self, values: Mapping[str, Any]) -> None:
        """The JSON file, whole."""
        self.path(".json").write_text(json.dumps(_plain(values), indent=1, allow_nan=False) + "\n", encoding="utf-8")


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    return "" if value is None else str(value)


def _plain(value: Any) -> Any:
    """Without NumPy's types, and with null for what JSON cannot say."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, float):
        return float(f"{value:.6g}") if np.isfinite(value) else None
    return value
