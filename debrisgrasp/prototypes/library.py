"""The dictionary of prototypes: load, choose, save, pack."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from debrisgrasp._arrays import require_range
from debrisgrasp._fields import require_distinct
from debrisgrasp._files import data_path, last_changed, write_together, yaml_files
from debrisgrasp._words import counted
from debrisgrasp.errors import (
    ChoiceError,
    ConfigError,
    InputError,
    OutputError,
    UnknownNameError,
)
from debrisgrasp.geometry.sampling import fibonacci_sphere

from .gripper import FURTHER_HANDS, GripperModel, load_grippers, require_hands
from .prototype import (
    DEFAULT_DENSITY,
    KINDS,
    GraspPrototype,
    PackedPrototypes,
    PrototypeDefinition,
)
from .prototype_file import prototype_files, read_prototype

__all__ = ["N_VIEWS", "PrototypeLibrary"]

_DENSITIES = 1e2, 1e7
"""Points per square metre that a surface can be sampled by: one in 10 cm to 0.3 mm."""
N_VIEWS = 400
"""Directions of view; the nearest of them is 4 degrees off on average."""


@dataclass(frozen=True, slots=True, eq=False)
class PrototypeLibrary:
    """A dictionary of prototypes with one density and one set of views."""

    prototypes: tuple[GraspPrototype, ...]
    grippers: Mapping[str, GripperModel]
    """The hands that they are for, and perhaps more."""

    def __post_init__(self) -> None:
        require_hands(self.grippers)
        require_distinct("names of prototypes", self.names)

    @classmethod
    def load(
        cls,
        path: str | os.PathLike[str] | None = None,
        *,
        grippers: Mapping[str, GripperModel] | None = None,
        density: float = DEFAULT_DENSITY,
    ) -> PrototypeLibrary:
        """Read all prototypes of a folder, or one file; None reads the shipped ones.

        Parameters
        ----------
        grippers
            Hands by name; None takes those that ship.
        density
            Points per square metre of surface.

        Raises
        ------
        ConfigError
            If a file is malformed, a name is given twice, or there is no file.
        UnknownNameError
            For a hand, preshape, shape or field that doesn't exist.
        """
        if grippers is None:
            grippers = load_grippers()
        require_hands(grippers)
        if path is not None:
            return _read(Path(path), grippers, density)
        shipped = data_path("prototypes")
        hands = tuple(sorted(grippers.items()))
        found = _shipped(shipped, last_changed(shipped), hands, density)
        return cls(found.prototypes, grippers)

    @classmethod
    def build(
        cls,
        definitions: Iterable[PrototypeDefinition],
        grippers: Mapping[str, GripperModel],
        *,
        density: float = DEFAULT_DENSITY,
    ) -> PrototypeLibrary:
        """Sample the shapes of definitions that were made in a program.

        Raises
        ------
        InputError
            If these are no definitions, or no hands by name.
        """
        require_hands(grippers)
        if not isinstance(definitions, Iterable):
            got = type(definitions).__name__
            raise InputError("definitions", got=got, expected="a list of definitions")
        require_range("points per square metre", density, *_DENSITIES)
        directions = fibonacci_sphere(N_VIEWS)
        prototypes = tuple(
            GraspPrototype.build(definition, directions, density)
            for definition in definitions
        )
        return cls(prototypes, grippers)

    def save(self, folder: str | os.PathLike[str]) -> None:
        """Write one file for each prototype, named after it.

        All of them or none, for half a dictionary looks like a whole one. In a folder
        that is there they replace what has their names.

        Raises
        ------
        OutputError
            If a file can't be written.
        """
        target = Path(folder)
        try:
            if target.exists():
                target.mkdir(exist_ok=True)  # raises for a file
                self._write(target)
            else:
                self._write_new(target)
        except OutputError:
            raise
        except OSError as error:
            raise OutputError(folder, error.strerror or str(error)) from error

    def _write_new(self, folder: Path) -> None:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=folder.parent, prefix=".prototypes-") as made:
            whole = Path(made) / folder.name
            whole.mkdir()
            try:
                self._write(whole)
            except OutputError as error:
                raise OutputError(folder, error.reason) from error
            whole.rename(folder)

    def _write(self, folder: Path) -> None:
        files: dict[Path, bytes | str] = {}
        for prototype in self.prototypes:
            path = folder / f"{prototype.name}.yaml"
            files |= prototype_files(prototype.definition, path)
        write_together(files)

    def __repr__(self) -> str:
        hands = ", ".join(sorted({prototype.gripper for prototype in self}))
        words = counted(len(self), "prototype")
        return f"<PrototypeLibrary of {words} for {hands or 'no hand'}>"

    def __iter__(self) -> Iterator[GraspPrototype]:
        return iter(self.prototypes)

    def __len__(self) -> int:
        return len(self.prototypes)

    def __contains__(self, item: object) -> bool:
        return item in self.names or item in self.prototypes

    def __getitem__(self, name: str) -> GraspPrototype:
        for prototype in self.prototypes:
            if prototype.name == name:
                return prototype
        raise UnknownNameError("prototype", name, self.names)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all prototypes, in order."""
        return tuple(prototype.name for prototype in self.prototypes)

    def select(
        self,
        *,
        gripper: str | None = None,
        names: str | Iterable[str] | None = None,
        kind: str | None = None,
    ) -> PrototypeLibrary:
        """Keep the prototypes of a hand, of one name or some, or of a kind.

        Raises
        ------
        UnknownNameError
            For a hand, a kind or a name that isn't in the dictionary.
        """
        if gripper is not None and gripper not in self.grippers:
            raise UnknownNameError(
                "gripper", gripper, self.grippers, mend=FURTHER_HANDS
            )
        if kind is not None and kind not in KINDS:
            raise UnknownNameError("kind of prototype", kind, KINDS)
        chosen = self.prototypes
        if names is not None:
            names = (names,) if isinstance(names, str) else names
            chosen = tuple(self[name] for name in dict.fromkeys(names))
        kept = tuple(
            prototype
            for prototype in chosen
            if gripper in (None, prototype.gripper) and kind in (None, prototype.kind)
        )
        return PrototypeLibrary(kept, self.grippers)

    def packed(self) -> PackedPrototypes:
        """Lay all prototypes out in arrays, padded to the largest.

        Raises
        ------
        ChoiceError
            If the library is empty.
        """
        if not self.prototypes:
            raise ChoiceError(
                "prototypes", got="none", expected="at least one", mend=_CHOOSE_MORE
            )
        directions = self.prototypes[0].visible.directions
        counts = [len(prototype.points) for prototype in self.prototypes]
        p, m = len(counts), max(counts)
        points, normals = np.zeros((p, m, 3)), np.zeros((p, m, 3))
        for row, (prototype, n) in enumerate(zip(self.prototypes, counts, strict=True)):
            points[row, :n] = prototype.points
            normals[row, :n] = prototype.normals
        mask = np.arange(m) < np.array(counts)[:, None]
        return PackedPrototypes(self.prototypes, points, normals, mask, directions)


_CHOOSE_MORE = "The choice of hand, names and kind leaves nothing."


@lru_cache(maxsize=4)
def _shipped(
    path: Path,
    _changed: object,
    grippers: tuple[tuple[str, GripperModel], ...],
    density: float,
) -> PrototypeLibrary:
    """Prototypes that ship: the same ones for all who ask, for they are sampled."""
    return _read(path, dict(grippers), density)


def _read(
    path: Path, grippers: Mapping[str, GripperModel], density: float
) -> PrototypeLibrary:
    """Prototypes of a folder, or of one file."""
    definitions: dict[str, PrototypeDefinition] = {}
    sources: dict[str, Path] = {}
    for file in _files(path):
        definition = read_prototype(file, grippers)
        if definition.name in definitions:
            raise ConfigError(
                f"{file}, field name",
                got=repr(definition.name),
                expected=f"a new name: {sources[definition.name]} has it",
            )
        definitions[definition.name] = definition
        sources[definition.name] = file
    return PrototypeLibrary.build(definitions.values(), grippers, density=density)


def _files(path: Path) -> list[Path]:
    if path.is_file():
        return [path]
    files = yaml_files(path, "prototypes")
    if not files:
        raise ConfigError(
            str(path),
            got="no .yaml file in it",
            expected="one file per prototype",
            mend="Make some with `debrisgrasp prototype new`, or name no folder: then "
            "those that ship are taken.",
        )
    return files
