"""The merge gate: a spec and its code, compared with the same spec and its code in the base.

From the head's spec to two sides that can be alternated:

1. The base's version of the spec is found: at the same path, or under the same name.
2. The base is built, if its version says how, in the environment that leads to the base's code.
3. The two specs are compared. A head whose verdict depends on less than the base's is an error.
4. What the nodes of each side are made of is identified.
5. Base and head are played alternately (`r2bspec.compare.interleaved_runs`). After each run,
   the files that its processes have loaded must be those of its side.

If there is nothing to compare with, the head alone is judged, and every report says why: the base
has no such spec; or the base cannot run, and the pipeline allows that. The head then is not asked
for what only a comparison can tell.

A spec of the head belongs to the spec of the base at the same path, or else to one that is gone
from its path and has the same ``name:``. A spec that is gone from the head can gate nothing any
more, and neither can a case that is gone from its matrix: both are a weaker gate.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import msgspec

from r2bspec.compare import gate_strength
from r2bspec.compare.base_environment import BaseBuildError, BaseBuilds, is_code_of
from r2bspec.compare.base_tree import BaseReference, BaseRevisionError, BaseTree
from r2bspec.compare.gate_change import GateChange
from r2bspec.compare.interleaved_comparison import BaseFailsError, ComparisonSide
from r2bspec.diagnostics.diagnostic import Span
from r2bspec.diagnostics.quote import clip, pluralize
from r2bspec.errors import ExitStatus, R2bspecError, without_output
from r2bspec.execute.errors import InterruptedRunError
from r2bspec.execute.identity.identify_graph import graph_identity
from r2bspec.execute.processes.environment import applied_environment
from r2bspec.execute.progress import Progress
from r2bspec.language.load_spec import LoadedSpec
from r2bspec.language.selected_spec import SpecSelection
from r2bspec.language.spec import GateBase, Objective, Pacing
from r2bspec.plan.comparability import difference_lines, graph_differences, load_differences
from r2bspec.plan.plan import Plan
from r2bspec.plan.prepared_benchmark import PreparedBenchmark
from r2bspec.record.graph_identity import GraphIdentity, identity_differences
from r2bspec.record.run_folder import read_loaded_files
from r2bspec.safe_io.file_search import walk
from r2bspec.safe_io.safe_file import is_regular

ALLOW_BASE = "base"
"""The name under which a pipeline allows a base that cannot run."""

_SPEC_SUFFIX = ".r2b.yaml"
_PLAYED_FIELDS = (
    *("play", "play_at_peak", "search", "sustained_hz", "starts", "phases"),
    *(*Pacing.__struct_fields__, "objectives", "gate"),
)
"""The fields of a plan that say how long and at which rates is played, and what is asked of it."""


Prepare = Callable[[SpecSelection], PreparedBenchmark]


class OtherSidesFilesError(R2bspecError):
    """A side of a comparison has loaded files of the other one."""

    code = "R2B696"
    exit_code = ExitStatus.USAGE


@dataclass(frozen=True)
class GateSettings:
    """What the pipeline says of a gate, apart from the base.

    Attributes:
        allow: names of what may be weaker than in the base, and ``base``.
        build: how the base is built, where its spec does not say it.
        force: compare even with different loads.
        known_names: names in `allow` that are for other specs.
    """

    allow: tuple[str, ...] = ()
    build: GateBase = field(default_factory=GateBase)
    force: bool = False
    known_names: tuple[str, ...] = ()


@dataclass(frozen=True)
class GateSides:
    """A head that is ready to be judged, and the base to compare it with.

    Attributes:
        head: with its objectives; without a base, only with those that need none.
        base: None if the head alone is judged.
        sentences: what every report says of the gate.
        differences: between the graphs of the two plans, a line each.
        changes: of the code, a line each.
    """

    head: ComparisonSide
    base: ComparisonSide | None
    sentences: tuple[str, ...] = ()
    differences: tuple[str, ...] = ()
    changes: tuple[str, ...] = ()


@dataclass
class MergeGate:
    """The gate of one call: one base, for any number of specs.

    Attributes:
        tree: the work tree of the base.
        reference: how the user named it, with values that are the base's alone.
        settings: what the pipeline says.
        prepare: checks and compiles a spec.
        names: that ``--allow`` may have, of all specs that have been compared.
    """

    tree: BaseTree
    reference: BaseReference
    settings: GateSettings
    prepare: Prepare
    names: set[str] = field(init=False, default_factory=set)
    _builds: BaseBuilds = field(init=False)

    def __post_init__(self) -> None:
        self._builds = BaseBuilds(self.tree)

    def sides(
        self, selection: SpecSelection, head: PreparedBenchmark, progress: Progress | None = None
    ) -> GateSides:
        """The two sides of a spec.

        Args:
            selection: of the head.
            head: as prepared from it.
            progress: is notified of builds.

        Raises:
            WeakerGateError: the head's verdict depends on less than the base's.
            BaseFailsError: the base's version is not valid, and that is not allowed.
            BaseBuildError: the base does not build, likewise.
            BaseRevisionError: the base would run code of the head.
        """
        found = self.base_spec(selection.spec, head)
        if found is None:
            return self.alone(head, self._new_spec(selection.spec))
        base_selection = self._base_selection(selection, found)
        if head.loaded is not None and head.loaded.case:
            cases = replace(base_selection, case="").load_cases()
            if head.loaded.case not in {loaded.case for loaded in cases}:
                return self.alone(
                    head, f"New case: {self.tree.name} has no {clip(head.loaded.case)}."
                )
        try:
            environment = self._builds.environment(
                self._build_settings(base_selection), progress or Progress()
            )
            with applied_environment(environment):
                base = self.prepare(base_selection)
                base_identity = graph_identity(
                    base.plan, base.base_dir, revision=self.tree.revision, top=self.tree.top
                )
        except InterruptedRunError:
            raise
        except R2bspecError as error:
            if ALLOW_BASE not in self.settings.allow:
                if isinstance(error, BaseBuildError | BaseRevisionError):
                    raise
                raise BaseFailsError.of(
                    error, f"{self.tree.name} cannot be compared with: {self._named(str(error))}"
                ) from error
            return self.alone_without_base(head, error)
        self.names.update(gate_strength.allowable_names(base, head))
        comparison = gate_strength.check_gate(
            base,
            head,
            self.settings.allow,
            base_name=self.tree.name,
            known_names=self.settings.known_names,
        )
        sentences = [*self.tree.notes, *comparison.sentences]
        if found.name != selection.spec.name:
            old = found.relative_to(self.tree.top)
            sentences.append(f"Renamed: the spec is {clip(str(old))} in {self.tree.name}.")
        as_head = msgspec.structs.replace(
            base.plan, **{name: getattr(head.plan, name) for name in _PLAYED_FIELDS}
        )
        otherwise = load_differences(as_head, head.plan)
        if otherwise and not self.settings.force:
            lines = "; ".join(difference_lines(otherwise, max_lines=3))
            return self.alone(
                head,
                f"Not compared with {self.tree.name}, whose load is another: {lines}.",
                *sentences,
            )
        head_identity = graph_identity(head.plan, head.base_dir, top=self.tree.head_top)
        changes = identity_differences(base_identity, head_identity)
        differences = graph_differences(as_head, head.plan)
        if not changes and not differences:
            sentences.append(
                f"Same spec and same code as {self.tree.name}: the graph is compared with itself."
            )
        return GateSides(
            head=self._side(head, head.plan, {}, head_identity, self.tree.head_top),
            base=self._side(base, as_head, environment, base_identity, self.tree.top),
            sentences=tuple(sentences),
            differences=tuple(difference_lines(differences)),
            changes=changes,
        )

    def builds_base(self, selection: SpecSelection, head: PreparedBenchmark) -> bool:
        """Whether commands are run to build the base of a spec; see `sides`."""
        base = self.base_spec(selection.spec, head)
        if base is None:
            return False
        try:
            return bool(self._build_settings(self._base_selection(selection, base)).build)
        except R2bspecError:
            # `sides` meets the same error, and says what it means for the gate.
            return False

    def _base_selection(self, selection: SpecSelection, spec: Path) -> SpecSelection:
        """The base's version of a spec, with the options of the head."""
        return replace(
            selection,
            spec=spec,
            sets=(*selection.sets, *self.reference.sets),
            variables={**(selection.variables or {}), **self.reference.variables},
            allow_paths=tuple(self.tree.in_base(path) or path for path in selection.allow_paths),
            # Of a stranger's change the base is no part: what it lists is what a head may read.
            untrusted=None,
        )

    def base_spec(self, spec: Path, head: PreparedBenchmark | None = None) -> Path | None:
        """The base's version of a spec: at its path, or one of its name that the head lacks."""
        same = self.tree.in_base(spec)
        if same is not None and is_regular(same):
            return same
        name = head.loaded.spec.name if head and head.loaded and head.loaded.spec else ""
        for path in _specs_below(self.tree.top) if name else ():
            if (self.tree.head_top / path.relative_to(self.tree.top)).exists():
                continue
            loaded = SpecSelection(path).load_cases()[0]
            if loaded.spec is not None and loaded.spec.name == name:
                return path
        return None

    def _new_spec(self, spec: Path) -> str:
        """Why there is nothing to compare a spec with, and what to do if it was renamed."""
        text = f"New spec: {self.tree.name} has nothing to compare it with."
        folder = self.tree.in_base(spec.parent)
        gone = [
            str(path.relative_to(self.tree.top))
            for path in (sorted(folder.glob(f"*{_SPEC_SUFFIX}")) if folder is not None else ())
            if not (self.tree.head_top / path.relative_to(self.tree.top)).exists()
        ]
        if gone:
            text += f" If it was {clip(gone[0])}, keep its 'name': then the two are compared."
        return text

    def _place_of_name(self, gone: SpecName) -> str:
        """Where the head has a spec of the same name; empty for nowhere."""
        for path in _specs_below(self.tree.head_top) if gone.name else ():
            if spec_name(SpecSelection(path).load_cases()).name == gone.name:
                return str(path.relative_to(self.tree.head_top))
        return ""

    def require_specs(self, base: Iterable[Path], head: Iterable[Path]) -> tuple[str, ...]:
        """Check that the head has every spec of the base, and every case, unless that is allowed.

        Args:
            base: specs of the base.
            head: specs of the head.

        Returns:
            What is gone and allowed, a sentence each.

        Raises:
            WeakerGateError: some are gone.
        """
        base_names = _spec_names(base, self.tree.top)
        head_names = _spec_names(head, self.tree.head_top)
        missing = (*missing_specs(base_names, head_names),)
        refused = [change for change in missing if change.name not in self.settings.allow]
        if refused:
            diagnostics = gate_strength.weakening_diagnostics(refused, None, self.tree.name)
            error = gate_strength.WeakerGateError(refused, diagnostics, None, self.tree.name)
            names = {change.name for change in refused}
            gone = [spec for path, spec in sorted(base_names.items()) if f"spec {path}" in names]
            if places := [*filter(None, map(self._place_of_name, gone))]:
                has = "has its name" if len(places) == 1 else "have their names"
                where = ", ".join(map(clip, places))
                error.hint = f"{where} {has}: let the pipeline run that. {error.hint}"
            elif gone and (new := sorted(head_names.keys() - base_names.keys())):
                error.hint = (
                    f"If {clip(new[0])} replaces it, write 'name: {clip(gone[0].name)}' there, and "
                    f"the two are compared. {error.hint}"
                )
            raise error
        return gate_strength.GateComparison(missing).sentences

    def alone(self, head: PreparedBenchmark, *sentences: str) -> GateSides:
        """The head without a base: what only a comparison can tell is not asked of it."""
        objectives, left_out = _without_baseline(head.plan.objectives)
        if left_out:
            number = pluralize(left_out, "requirement")
            sentences += (f"{number} of the baseline: not judged without a base.",)
        identity = graph_identity(head.plan, head.base_dir, top=self.tree.head_top)
        plan = msgspec.structs.replace(head.plan, objectives=objectives)
        side = self._side(head, plan, {}, identity, self.tree.head_top)
        return GateSides(side, None, sentences)

    def alone_without_base(self, head: PreparedBenchmark, error: R2bspecError) -> GateSides:
        """The head alone, because the base cannot run, and that is allowed."""
        first = without_output(self._named(str(error)))
        return self.alone(head, f"Allowed: base. {self.tree.name} cannot run: {first}")

    def check_loaded_files(self, side: str, folder: Path) -> None:
        """Check that the processes of a run have loaded the files of their side.

        Raises:
            OtherSidesFilesError: some are of the other one.
        """
        other = "head" if side == "base" else "base"
        for process, files in read_loaded_files(folder).items():
            for file in files:
                if is_code_of(Path(file), self.tree, other):
                    top = self.tree.top if other == "base" else self.tree.head_top
                    raise OtherSidesFilesError(
                        f"in a run of the {side}, {process} loaded {file} of the {other} ({top}): "
                        "the two cannot be compared",
                        hint="Something leads there besides search paths and editable packages, "
                        "such as an absolute path in the spec or in a parameter. Name files "
                        "relative to the spec, or build the base with benchmark.gate.base.",
                    )

    def _side(
        self,
        prepared: PreparedBenchmark,
        plan: Plan,
        environment: Mapping[str, str],
        identity: GraphIdentity,
        top: Path,
    ) -> ComparisonSide:
        return ComparisonSide(
            plan, prepared.base_dir, prepared.spec_text, environment, identity=identity, top=top
        )

    def _build_settings(self, selection: SpecSelection) -> GateBase:
        """How the base is built: as its own version of the spec says, or else as the pipeline."""
        loaded = selection.load()
        self._share_recordings(loaded)
        own = loaded.spec.benchmark.gate.base if loaded.spec is not None else GateBase()
        return own if own.build or own.setup else self.settings.build

    def _share_recordings(self, loaded: LoadedSpec) -> None:
        """Let the base play a recording of the head that git does not have.

        Recordings are often downloaded, and ignored by git. Both sides are to play the same.
        """
        if self.reference.folder is not None or loaded.spec is None:
            return
        for source in loaded.spec.data_loader.sources:
            place = Path(os.path.normpath(loaded.base_dir / source.path))
            if not source.path or place.exists() or not place.is_relative_to(self.tree.top):
                continue
            original = self.tree.head_top / place.relative_to(self.tree.top)
            if original.exists():
                with contextlib.suppress(OSError):
                    place.parent.mkdir(parents=True, exist_ok=True)
                    place.symlink_to(original)

    def _named(self, text: str) -> str:
        """A text in which files of the base have the names that they have in the repository."""
        return text.replace(f"{self.tree.top}/", "")


def _specs_below(folder: Path) -> list[Path]:
    """The specs of a work tree, sorted; hidden folders are left out."""
    specs: list[Path] = []
    for parent, folders, files in walk(folder):
        folders[:] = [name for name in folders if not name.startswith(".")]
        specs += (parent / name for name in files if name.endswith(_SPEC_SUFFIX))
    return sorted(specs)


def _spec_names(files: Iterable[Path], top: Path) -> dict[str, SpecName]:
    """The name and the cases of each spec, by its path below the top of its tree."""
    return {
        os.path.relpath(file.resolve(), top): spec_name(SpecSelection(file).load_cases())
        for file in files
    }


def _without_baseline(
    objectives: Mapping[str, Objective],
) -> tuple[dict[str, Objective], int]:
    """Objectives without requirements of the baseline, and how many those are."""
    kept: dict[str, Objective] = {}
    left_out = 0
    for name, objective in objectives.items():
        require: Sequence[object] = [
            requirement for requirement in objective.require if not requirement.of_baseline
        ]
        left_out += len(objective.require) - len(require)
        if require:
            kept[name] = msgspec.structs.replace(objective, require=tuple(require))
    return kept, left_out


@dataclass(frozen=True)
class SpecName:
    """The ``name:`` of a spec, and the cases of its matrix; none without a matrix."""

    name: str
    cases: tuple[str, ...] = ()


def spec_name(cases: Sequence[LoadedSpec]) -> SpecName:
    """The name of a document from all its cases (`r2bspec.language.load_spec.load_cases`)."""
    specs = [case.spec for case in cases if case.spec is not None]
    name = specs[0].name if specs else ""
    return SpecName(name, tuple(case.case for case in cases if case.case))


def missing_specs(
    base: Mapping[str, SpecName], head: Mapping[str, SpecName]
) -> Iterator[GateChange]:
    """The specs that the head lacks, named ``spec PATH``, and the cases, ``case NAME[CASE]``.

    Args:
        base: the name of each spec by its path below the top of its tree.
        head: the same of the head.
    """
    bases = {path: path for path in head if path in base} | _renamed(base, head)
    for path in sorted(base.keys() - set(bases.values())):
        span = Span.of_file(path)
        yield GateChange(f"spec {path}", (), f"benchmark {base[path].name}", "", span=span)
    for path, spec in head.items():
        was = base[bases[path]] if path in bases else SpecName("")
        for case in was.cases:
            if case not in spec.cases:
                name, span = f"case {was.name}[{case}]", Span.of_file(path)
                yield GateChange(name, ("matrix",), f"a case of {path}", "", span=span)


def _renamed(base: Mapping[str, SpecName], head: Mapping[str, SpecName]) -> dict[str, str]:
    """The path in the base of each spec that is at a new path in the head."""
    left = [path for path in sorted(base) if path not in head]
    renamed = {}
    for path in sorted(head.keys() - base.keys()):
        name = head[path].name
        same = [other for other in left if name and base[other].name == name]
        if same:
            renamed[path] = same[0]
            left.remove(same[0])
    return renamed
