import contextlib

from mixpinn.base.progress import console, quiet


def test_quiet_silences_and_gives_the_voice_back(capsys):
    with contextlib.suppress(RuntimeError), quiet():
        console.print("hidden")
        raise RuntimeError
    console.print("shown")
    err = capsys.readouterr().err
    assert "shown" in err
    assert "hidden" not in err
