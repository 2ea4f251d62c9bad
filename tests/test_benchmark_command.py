"""What the measuring commands share: nothing is measured in vain, and rows say what measured them."""

import json

import pytest

from benchmarks.command import report
from benchmarks.run import machine
from benchmarks.tables import prepare


def test_what_cannot_serve_is_refused_in_one_line_before_any_work(tmp_path):
    for json_file, device, words in (
        (tmp_path / "no" / "rows.json", "cpu", "json: cannot write to"),
        (None, "nowhere", "device: 'nowhere'"),
    ):
        with pytest.raises(SystemExit, match=words) as refusal:
            prepare(json_file, device)
        assert "\n" not in str(refusal.value)
    assert prepare(tmp_path / "rows.json", "cpu") == "cpu"


def test_rows_are_written_with_what_measured_them_and_their_table_is_printed(tmp_path, capsys):
    def measure(*, device, watch):
        watch("a case", 1, "frames")(1)
        return [{"area_error": 0.25, "on": device}]

    file = tmp_path / "rows.json"
    report(measure, lambda rows: f"| {rows[0]['area_error']} |", json_file=file, device="cpu")
    assert capsys.readouterr().out == "| 0.25 |\n"
    (row,) = json.loads(file.read_text())
    known = machine("cpu")
    assert row.keys() == {"area_error", "on", *known}
    assert (row["area_error"], row["on"]) == (0.25, "cpu")
    assert all(row[name] == value for name, value in known.items() if name != "date")


def test_nothing_is_measured_when_its_rows_could_not_be_written(tmp_path):
    def measure(**_):
        raise AssertionError("measured")

    with pytest.raises(SystemExit, match="json: cannot write to"):
        report(measure, str, json_file=tmp_path / "no" / "rows.json", device="cpu")
