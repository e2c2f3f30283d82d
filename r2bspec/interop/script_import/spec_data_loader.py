"""The section ``data_loader`` of an imported spec."""

from __future__ import annotations

from dataclasses import dataclass

from r2bspec.datasets.sequences import SEQUENCES
from r2bspec.interop.script_import.benchmark_script import BenchmarkScript
from r2bspec.interop.script_import.evaluator import Note
from r2bspec.interop.script_import.launch_actions import NodeAction
from r2bspec.interop.script_import.node_roles import ScriptGraph, input_numbers, remapped
from r2bspec.interop.script_import.script_settings import ScriptSettings
from r2bspec.interop.script_import.spec_values import SpecValues
from r2bspec.interop.script_import.yaml_writer import Block


@dataclass(frozen=True, slots=True)
class DataLoaderWriter:
    """Writes what a script loads.

    Attributes:
        namespace: of the benchmark, absolute.
        notes: is extended by what has no form in a spec.
        changes: is extended by what the spec says in another way.
    """

    script: BenchmarkScript
    settings: ScriptSettings
    graph: ScriptGraph
    namespace: str
    values: SpecValues
    notes: list[Note]
    changes: list[Note]

    def block(self) -> Block:
        """The keys of ``data_loader``."""
        block = Block()
        path = self.settings.value("input_data_path", "")
        if not isinstance(path, str) or not path:
            self.settings.lost("input_data_path", path)
            path = "recording"
        dataset = path.rstrip("/").rpartition("/")[2]
        recorded = {f"/{each}" for each in _topics_of(dataset)}
        topics = self._loaded_topics(recorded)
        if self._is_enough(recorded, topics):
            block.add("bag", dataset, self.settings.comments("input_data_path"))
        else:
            if recorded:
                self._note_synthetic(dataset, recorded, topics)
            full = path if path.startswith("/") else f"$(assets)/{path}"
            block.add("bag", self.values.text(full), self.settings.comments("input_data_path"))
        block.add("window", self._window(), self.settings.comments("input_data_start_time"))
        block.add("topics", topics)
        for key, source in (
            ("publish_tf", "publish_tf_messages_in_set_data"),
            ("publish_tf_static", "publish_tf_static_messages_in_set_data"),
            ("real_time", "load_data_in_real_time"),
        ):
            if self.settings.flag(source):
                block.add(key, True, self.settings.comments(source))
        return block

    def _is_enough(self, recorded: set[str], topics: dict[str, str]) -> bool:
        """Whether the synthetic dataset of that name has all that the script loads."""
        needs_tf = self.settings.flag("publish_tf_messages_in_set_data")
        needs_static = self.settings.flag("publish_tf_static_messages_in_set_data")
        wanted = {*topics, *(["/tf"] * needs_tf), *(["/tf_static"] * needs_static)}
        return bool(recorded) and wanted <= recorded

    def _note_synthetic(self, dataset: str, recorded: set[str], topics: dict[str, str]) -> None:
        missing = ", ".join(sorted({*topics} - recorded)) or "transforms"
        message = (
            f"the synthetic dataset {dataset} has no {missing}: the recording of the script is "
            "needed, below 'assets_root'"
        )
        place = self.script.config.place_of("input_data_path")
        self.changes.append(Note(message, place))

    def _window(self) -> dict[str, str]:
        start = self.settings.number("input_data_start_time", -1)
        end = self.settings.number("input_data_end_time", -1)
        found = {}
        if start > 0:
            found["start"] = f"{start:g} s"
        if end > 0:
            found["end"] = f"{end:g} s"
        return found

    def _loaded_topics(self, recorded: set[str]) -> dict[str, str]:
        loader = self.graph.loader
        found: dict[str, str] = {}
        for each in loader.remappings if loader else []:
            inside = f"{self.namespace}/"
            if each.source.startswith("/") and not each.source.startswith(inside):
                # It never matches: the loader's own name is in the namespace of the benchmark.
                found.setdefault(each.source, each.source.lstrip("/"))
                continue
            found.setdefault(f"/{each.source.removeprefix(inside)}", each.target)
        wanted = [
            one.target
            for each in self.graph.preprocessors
            if isinstance(each, NodeAction)
            for one in each.remappings
        ]
        player = self.graph.player
        if player is not None:
            wanted += [remapped(player, f"buffer/input{n}") for n in input_numbers(player)]
        for topic in wanted:
            if f"/{topic}" in recorded and f"/{topic}" not in found:
                # The loader of ros2_benchmark publishes every topic of the recording.
                found[f"/{topic}"] = topic
        if not found and loader is not None:
            self.notes.append(Note("no loaded topic is named in the script", loader.source.place))
        return found


def _topics_of(dataset: str) -> list[str]:
    known = SEQUENCES.get(dataset)
    return [] if known is None else [each.name.lstrip("/") for each in known.sources]
