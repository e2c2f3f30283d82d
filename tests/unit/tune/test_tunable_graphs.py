"""The graphs by which real searches are measured have the deployment that is known of them."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("rosbags")

from r2bspec import api
from r2bspec.language.selected_spec import SpecSelection
from tunable_graphs import tunable_graphs, write_graph


def test_each_known_deployment_is_in_the_space_of_its_graph(tmp_path: Path) -> None:
    graphs = list(tunable_graphs())
    assert len({graph.name for graph in graphs}) == 20
    for graph in graphs:
        selection = SpecSelection(write_graph(graph, tmp_path / graph.name))
        space = api.tuning_space(api.prepare(selection), selection)
        settings = [setting.sets for lever in space.levers for setting in lever.settings]
        assert graph.known in settings, graph.name
