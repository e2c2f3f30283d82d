"""Options take quantities of the language; a bare number is answered with its unit."""

from __future__ import annotations

import click
import pytest

from r2bspec.cli.main import main
from r2bspec.cli.shared_options import duration, share
from r2bspec.language.quantities import Duration, Share


def test_a_quantity_is_read_with_its_unit() -> None:
    assert duration("1 s", "10 min").convert("1500 ms", None, None) == Duration(1_500_000_000)
    assert share("1 %", "100 %").convert("2.5%", None, None) == Share(0.025)


@pytest.mark.parametrize("text", ["20", "20 Hz", "0.5 s", "11 min", "soon"])
def test_anything_else_is_refused(text: str) -> None:
    with pytest.raises(click.BadParameter):
        duration("1 s", "10 min").convert(text, None, None)


@pytest.mark.parametrize(
    ("arguments", "proposal"),
    [
        (("interfaces", "a.r2b.yaml", "--timeout", "20"), "'20 s'"),
        (("compare", "a", "b", "--margin", "5"), "'5 %'"),
    ],
)
def test_the_unit_is_proposed(
    arguments: tuple[str, ...], proposal: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(list(arguments)) == 2
    assert proposal in capsys.readouterr().err
