"""The way into the commands."""

from cases.entry import start


def test_ctrl_c_during_the_imports_is_one_sentence(tmp_path, monkeypatch, capsys):
    (tmp_path / "slow_import.py").write_text("raise KeyboardInterrupt\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert start("slow_import", "main") == 130
    assert capsys.readouterr().err == "error: interrupted\n"


def test_the_function_gets_its_arguments_and_gives_the_exit_code(tmp_path, monkeypatch):
    (tmp_path / "quick_import.py").write_text("def main(a, b):\n    return a + b\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert start("quick_import", "main", 3, 4) == 7
