"""Progress of a long command whose standard error is not a terminal."""

import time

from hertzloop.cli import terminal


def test_lines_follow_without_a_terminal_even_if_nothing_advances(capsys, monkeypatch):
    monkeypatch.setattr(terminal, "_FIRST_LINE_S", 0.05)
    monkeypatch.setattr(terminal, "_LINE_S", 0.05)
    terminal.set_quiet(False)
    with terminal.progress("budget", 4) as advance:
        time.sleep(0.2)
        silent = capsys.readouterr().err
        advance(1, "budget: bits")
        time.sleep(0.2)
    told = capsys.readouterr().err
    assert silent.startswith("budget: 0 s so far")
    assert "budget: bits: 25 % after 0 s, about 1 s left" in told


def test_a_short_command_has_no_line(capsys):
    with terminal.progress("run", 10) as advance:
        advance(10)
    assert capsys.readouterr().err == ""
