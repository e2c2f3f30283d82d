"""The merge gate: a spec and its code, compared with the same spec and its code in the base.

From the head's spec to two sides that can be alternated:

1. Every spec of the base is in the head (`r2bspec.compare.gated_specs`).
2. What the verdict depends on is the same, or allowed (`r2bspec.compare.gate_rules`).
3. The base is built, if its version says how, in the environment that leads to the base's code.
   What is played is the base's graph with everything else of the head's spec.
4. Both sides get the same messages (`r2bspec.compare.gated_input`).
5. What the nodes of each side are made of is identified.
6. Base and head are played alternately (`r2bspec.compare.interleaved_runs`). After each run,
   the files that its processes have loaded must be those of its side, and what was played must be
   what the other side was played.

If there is nothing to compare with, the head alone is judged, and every report says why: the base
has no such spec; or the base cannot run, and the pipeline allows that. The head then is not asked
for what only a comparison can tell.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import msgspec

from r2bspec.compare import gated_input
from r2bspec.compare.base_environment import BaseBuildError, BaseBuilds, is_code_of
from r2bspec.compare.base_tree import BaseRevisionError, BaseTree
from r2bspec.compare.gate_rules import (
    ALLOW_BASE,
    ALLOW_INPUT,
    GATED,
    GateChange,
    WeakerGateError,
    allowable_names,
    gate_changes,
)
from r2bspec.compare.gated_specs import GatedSpec, GatedSpecs, select_specs
from r2bspec.compare.interleaved_comparison import BaseFailsError, ComparisonSide
from r2bspec.diagnostics.quote import clip, pluralize, printable
from r2bspec.errors import ExitStatus, R2bspecError, without_output
from r2bspec.execute.errors import InterruptedRunError
from r2bspec.execute.identity.identify_graph import graph_identity
from r2bspec.execute.processes.environment import applied_environment
from r2bspec.execute.states import Progress
from r2bspec.language.load_spec import LoadedSpec
from r2bspec.language.selected_spec import SpecSelection
from r2bspec.language.spec import Objective, Spec
from r2bspec.plan.plan import Plan
from r2bspec.plan.prepared_benchmark import PreparedBenchmark
from r2bspec.record.graph_identity import GraphIdentity
from r2bspec.record.run_folder import open_run, read_loaded_files

PrepareLoaded = Callable[[LoadedSpec], PreparedBenchmark]


class OtherSidesFilesError(R2bspecError):
    """A side of a comparison has loaded files of the other side."""

    code = "R2B696"
    exit_code = ExitStatus.USAGE


@dataclass(frozen=True)
class GateSides:
    """A head that is ready to be judged, and the base to compare it with.

    Attributes:
        head: with its objectives; without a base, only with those that need none.
        base: None if the head alone is judged.
        sentences: what every report says of the gate.
        check: the check of each run; None without a base.
    """

    head: ComparisonSide
    base: ComparisonSide | None
    sentences: tuple[str, ...] = ()
    check: RunCheck | None = None


@dataclass(frozen=True)
class ComparedSpec:
    """A case of the head, and the case of the base whose gate it has.

    Attributes:
        head: prepared.
        base: None if there is nothing to compare with.
        sentences: what every report says of it.
    """

    head: PreparedBenchmark
    base: LoadedSpec | None
    sentences: tuple[str, ...] = ()


@dataclass
class MergeGate:
    """The gate of one call: a base, for any number of specs.

    Attributes:
        tree: the files of the base.
        allow: names of what may differ, and ``base`` and ``input``.
        prepare: checks and compiles a document.
        names: the names that `allow` may have, of all specs that have been compared.
    """

    tree: BaseTree
    allow: tuple[str, ...]
    prepare: PrepareLoaded
    names: set[str] = field(init=False, default_factory=set)
    _builds: BaseBuilds = field(init=False)

    def __post_init__(self) -> None:
        self._builds = BaseBuilds(self.tree)

    def select(self, paths: Sequence[str]) -> GatedSpecs:
        """Return the specs under some paths.

        Raises:
            GatedPathError: a path cannot be gated.
            WeakerGateError: specs or cases of the base are gone, and that is not allowed.
        """
        selected = select_specs(self.tree, paths)
        self._require_allowed(selected.gone, None)
        return replace(selected, notes=(*selected.notes, *self._allowed(selected.gone)))

    def compare(
        self, spec: GatedSpec, selection: SpecSelection, head: PreparedBenchmark
    ) -> ComparedSpec:
        """Compare everything that the verdict depends on; nothing is executed.

        Args:
            spec: with its place in the base.
            selection: the selection of the head, with its case.
            head: as prepared from it.

        Raises:
            WeakerGateError: something differs, and is not allowed.
            BaseFailsError: the base's version is not valid, and that is not allowed.
        """
        loaded = head.loaded
        if loaded is None or loaded.spec is None:
            raise ValueError("a gate compares documents")
        self.names |= allowable_names(loaded.spec)
        if not spec.base:
            new = f"New spec: {self.tree.name} has nothing to compare it with."
            return ComparedSpec(head, None, (new,))
        base = self._base_case(spec, selection, loaded.case)
        if base is None:
            new = f"New case: {self.tree.name} has no {clip(loaded.case)}."
            return ComparedSpec(head, None, (new,))
        if base.spec is None:
            first = next(each for each in base.diagnostics if each.severity == "error")
            error = BaseFailsError(
                f"{self.tree.name} cannot be compared with: {clip(spec.base)} is not valid: "
                f"{first.message} ({first.code})"
            )
            return ComparedSpec(head, None, (self._allowed_base(error),))
        self.names |= allowable_names(base.spec)
        changes = [*gate_changes(base, loaded), *self._since_it_left(spec, base)]
        self._require_allowed(changes, loaded)
        sentences = list(self._allowed(changes))
        if spec.place != spec.base:
            sentences.append(f"Renamed: the spec is {clip(spec.base)} in {self.tree.name}.")
        return ComparedSpec(head, base, tuple(sentences))

    def sides(self, compared: ComparedSpec, progress: Progress | None = None) -> GateSides:
        """Build the base, and return the two sides.

        Args:
            compared: from `compare`.
            progress: is notified of builds.

        Raises:
            WeakerGateError: the input differs, and that is not allowed.
            BaseFailsError: the base cannot be prepared, and that is not allowed.
            BaseBuildError: the base does not build, likewise.
            BaseRevisionError: the base would run code of the head.
        """
        head, loaded = compared.head, compared.head.loaded
        if compared.base is None or compared.base.spec is None:
            return self._alone(head, compared.sentences)
        if loaded is None or loaded.spec is None:
            raise ValueError("a gate compares documents")
        take = ALLOW_INPUT in self.allow
        mixed = replace(compared.base, spec=_with_gate_of(loaded.spec, compared.base.spec))
        assert mixed.spec is not None  # noqa: S101 - it has just been made
        changes = gated_input.share_recordings(self.tree, mixed.spec, mixed.base_dir, take=take)
        head_identity = self._identity(head, self.tree.head_top)
        try:
            settings = compared.base.spec.benchmark.gate.base
            environment = self._builds.environment(settings, progress or Progress())
            with applied_environment(environment):
                base = self.prepare(mixed)
                base_identity = self._identity(base, self.tree.top)
                if take:
                    gated_input.take_preprocessors(
                        self.tree, base_identity, head_identity, head.plan
                    )
                    base_identity = self._identity(base, self.tree.top)
        except InterruptedRunError:
            raise
        except R2bspecError as error:
            return self._alone(head, (*compared.sentences, self._allowed_base(error)))
        recordings = gated_input.compare_recordings(
            base.plan, base.base_dir, head.plan, head.base_dir
        )
        changes += recordings.changes
        changes += gated_input.preprocessor_changes(base_identity, head_identity, head.plan)
        self._require_allowed(changes, loaded)
        sentences = [*self.tree.notes, *compared.sentences]
        if take:
            sentences.append(f"Allowed: {ALLOW_INPUT}. Both sides get that of the head.")
        if loaded.spec == compared.base.spec and not compared.sentences and not take:
            sentences.append(f"Same spec as {self.tree.name}.")
        return GateSides(
            self._side(head, head.plan, {}, head_identity, self.tree.head_top),
            self._side(base, base.plan, environment, base_identity, self.tree.top),
            tuple(sentences),
            RunCheck(
                self.tree,
                recordings.digests,
                is_prepared="preprocess" in head.plan.phases,
                may_differ=take,
            ),
        )

    def alone_without_base(self, compared: ComparedSpec, error: R2bspecError) -> GateSides:
        """Return the head alone, because the base cannot run, and the pipeline allows that."""
        return self._alone(compared.head, (*compared.sentences, self._allowed_base(error)))

    def _base_case(self, spec: GatedSpec, selection: SpecSelection, case: str) -> LoadedSpec | None:
        """Return the base's version of a case; that of a spec without a matrix is every case's."""
        of_base = replace(
            selection,
            spec=self.tree.top / spec.base,
            case="",
            allow_paths=(self.tree.top,),
        )
        cases = of_base.load_cases()
        return next((each for each in cases if each.case in {"", case}), None)

    def _since_it_left(self, spec: GatedSpec, base: LoadedSpec) -> Iterator[GateChange]:
        """Yield the files of a spec that the base has otherwise since the head left."""
        for file in map(Path, base.sources):
            if file.is_relative_to(self.tree.top):
                path = str(file.relative_to(self.tree.top))
                if self.tree.has_newer(path):
                    after = f"that of {self.tree.name}"
                    name = f"spec {printable(spec.place)}"
                    yield GateChange.of_tip(name, path, self.tree.tip, after)

    def _require_allowed(self, changes: Sequence[GateChange], head: LoadedSpec | None) -> None:
        refused = [change for change in changes if change.name not in self.allow]
        if refused:
            raise WeakerGateError(refused, head, self.tree.name)

    def _allowed(self, changes: Sequence[GateChange]) -> tuple[str, ...]:
        """Return what reports say of changes that are allowed."""
        return tuple(f"Allowed: {change.name} ({change.text})." for change in changes)

    def _allowed_base(self, error: R2bspecError) -> str:
        """Return what reports say of a base that cannot run, if that is allowed.

        Raises:
            R2bspecError: it is not.
        """
        if ALLOW_BASE in self.allow:
            first = without_output(self._named(str(error)))
            return f"Allowed: base. {self.tree.name} cannot run: {first}"
        if isinstance(error, BaseBuildError | BaseRevisionError | BaseFailsError):
            raise error
        raise BaseFailsError.of(
            error, f"{self.tree.name} cannot be compared with: {self._named(str(error))}"
        ) from error

    def _alone(self, head: PreparedBenchmark, sentences: Sequence[str]) -> GateSides:
        """Return the head without a base: what only a comparison can tell is not asked of it."""
        objectives, left_out = _without_baseline(head.plan.objectives)
        said = [*sentences]
        if left_out:
            number = pluralize(left_out, "requirement")
            said.append(f"{number} of the baseline: not judged without a base.")
        plan = msgspec.structs.replace(head.plan, objectives=objectives)
        identity = self._identity(head, self.tree.head_top)
        side = self._side(head, plan, {}, identity, self.tree.head_top)
        return GateSides(side, None, tuple(said))

    def _identity(self, prepared: PreparedBenchmark, top: Path) -> GraphIdentity:
        revision = self.tree.revision if top == self.tree.top else None
        return graph_identity(prepared.plan, prepared.base_dir, revision=revision, top=top)

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

    def _named(self, text: str) -> str:
        """Return a text in which files of the base have their names in the repository."""
        return text.replace(f"{self.tree.top}/", "")


@dataclass
class RunCheck:
    """Checks the runs of a comparison: each has loaded the files of its side, and played the same.

    Outputs of preprocessors can differ from run to run. Then nothing shows that both sides had the
    same input, unless they are played the same buffers, as they are by turns.

    Attributes:
        tree: the tree of the base.
        recordings: the digests of those that were compared.
        is_prepared: whether there are preprocessors.
        may_differ: whether the pipeline allows another input.
    """

    tree: BaseTree
    recordings: frozenset[str]
    is_prepared: bool
    may_differ: bool
    _played: dict[str, list[str]] = field(default_factory=lambda: {"base": [], "head": []})

    def __call__(self, side: str, folder: Path) -> None:
        """Check the folder of a run.

        Raises:
            OtherSidesFilesError: it has loaded files of the other side.
            WeakerGateError: what was played differs from what the other side was played, or cannot
                be compared with it.
        """
        self._check_loaded_files(side, folder)
        dataset = open_run(folder).record.dataset
        for recording in (dataset, *dataset.get("also", ())):
            read = recording.get("sha256", "")
            if recording.get("kind") == "recorded" and read not in self.recordings:
                self._refuse("", f"{clip(recording['source'])}, which was rewritten for the run")
        self._played[side].append(dataset.get("played", ""))
        base, head = (self._played[name] for name in ("base", "head"))
        enough = 2 if self.is_prepared else 1
        if min(len(base), len(head)) < enough:
            return
        if len({*base}) > 1 or len({*head}) > 1:
            self._refuse("", "preprocessors that make other messages in each run")
        elif base[0] != head[0]:
            self._refuse(*(f"messages with the digest {each[:12]}" for each in (base[0], head[0])))

    def _refuse(self, before: str, after: str) -> None:
        """Refuse an input that the other side was not given, unless the pipeline allows it."""
        if not self.may_differ:
            change = GateChange(ALLOW_INPUT, ("playback", "inputs"), before, after)
            raise WeakerGateError([change], None, self.tree.name)

    def _check_loaded_files(self, side: str, folder: Path) -> None:
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


def _with_gate_of(head: Spec, base: Spec) -> Spec:
    """Return the base's graph with everything of the head's spec that a verdict depends on.

    Monitors of topics that only the head has are left out.
    """
    gate = {section: getattr(head, section) for section in GATED}
    gate["monitors"] = {
        name: head.monitors[name] for name in base.monitors if name in head.monitors
    }
    return msgspec.structs.replace(base, **gate, slos=head.slos, variables=head.variables)


def _without_baseline(
    objectives: Mapping[str, Objective],
) -> tuple[dict[str, Objective], int]:
    """Return objectives without requirements of the baseline, and how many those are."""
    kept: dict[str, Objective] = {}
    left_out = 0
    for name, objective in objectives.items():
        require = tuple(each for each in objective.require if not each.of_baseline)
        left_out += len(objective.require) - len(require)
        if require:
            kept[name] = msgspec.structs.replace(objective, require=require)
    return kept, left_out
