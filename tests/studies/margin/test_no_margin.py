"""What `hertzloop margin` says about a law without a linear loop in flight."""

import json

from tests.commands import invoke


def test_the_command_points_to_the_budget(tmp_path):
    def margin(*words: str) -> str:
        done = invoke(["margin", "aluminium-3mm", *words, "--json", str(tmp_path / "m.json")])
        assert done.exit_code == 0, done.output
        assert json.loads((tmp_path / "m.json").read_text())["applicable"] is False
        return " ".join(done.output.split())

    said = margin()
    assert "No margin: not a linear loop (it waits for a threshold" in said
    assert "hertzloop budget" in said
    said = margin("--law", "off")
    assert "so there is no loop. Name a law, for example --law velocity_feedback." in said
    assert "budget" not in said
    said = margin("--law", "force_feedback", "--set", "sensors.quantity=contact_force")
    assert "the contact force is zero in flight" in said
    assert "hertzloop budget" in said
