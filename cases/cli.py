"""The command line of the cases: options, exit codes, and one sentence for whatever goes wrong.

Exit codes: 0 done; 1 a stage did not converge, or a file could not be written; 2 the case, an
option or the input is wrong; 130 interrupted (Ctrl-C), 143 terminated; files that were finished
by then are kept.
"""

import os
import signal
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, CycloptsError, Parameter

from cases.run_folder import STAGES
from meshes.errors import InvalidCase, InvalidMesh, NotConverged

Stage = Literal["mesh", "topopt", "isosurface", "smooth", "remesh"]


@dataclass(frozen=True)
class RunOptions:
    """What the command line says besides the case.

    Parameters
    ----------
    preset : str or None
    settings : tuple of str
        "key=value" each.
    out : Path or None
    force : bool
    first, last : str
        The stages to run.
    threads : int or None
    quiet, verbose : bool
    resume : bool
        Go on where an earlier run of the same case in the same folder ended.
    """

    preset: str | None = None
    settings: tuple[str, ...] = ()
    out: Path | None = None
    force: bool = False
    first: str = STAGES[0]
    last: str = STAGES[-1]
    threads: int | None = None
    quiet: bool = False
    verbose: bool = False
    resume: bool = False


def make_app(command, takes_file, run):
    """The cyclopts application of a command; `run(path, options)` does the work.

    Parameters
    ----------
    command : str
        How the command is called, for --help.
    takes_file : bool
        Whether it takes a case file, or has its own.
    run : callable
    """
    app = App(
        name=command,
        help="From a load case in YAML to a printable part: mesh, topology optimisation, "
        "isosurface, smoothing, curvature-adapted remeshing.",
        help_format="plaintext",
        version_flags=[],
        result_action="return_value",
        suppress_keyboard_interrupt=False,
    )

    def _run(
        file: Annotated[str | None, Parameter(show=takes_file)] = None,
        /,
        *,
        preset: str | None = None,
        set_: Annotated[
            list[str] | None, Parameter(name="--set", consume_multiple=True, negative="")
        ] = None,
        out: Path | None = None,
        force: Annotated[bool, Parameter(negative="")] = False,
        stop_after: Stage = "remesh",
        from_: Annotated[Stage, Parameter(name="--from")] = "mesh",
        resume: Annotated[bool, Parameter(negative="")] = False,
        threads: int | None = None,
        quiet: Annotated[bool, Parameter(negative="")] = False,
        verbose: Annotated[bool, Parameter(name=["--verbose", "-v"], negative="")] = False,
        schema: Annotated[bool, Parameter(negative="")] = False,
    ):
        """
        Parameters
        ----------
        file
            The case, a YAML file.
        preset
            One of the presets in the case's YAML (ours have thesis, certified and preview).
        set_
            KEY=VALUE: a dotted key of the YAML and its value, as
            topopt.volume_fraction=0.1; may be given again and again.
        out
            The folder for the results; runs/<case name> if not given. A folder that holds another
            run's files is refused without --force.
        force
            Replace another run's files in the folder.
        stop_after
            The last stage to run.
        from_
            The first stage to run; the files of the earlier ones are used again, as in
            --from remesh --set remesh.sigma=0.02.
        resume
            Go on where the run in the folder was interrupted or killed, with the same case. A
            finished optimisation goes on if topopt.steps or topopt.tolerance now ask for more.
        threads
            Threads to compute with; all cores if not given. The results are the same.
        quiet
            Print nothing but errors.
        verbose
            Print every step.
        schema
            Print the JSON Schema of case files, by which an editor completes them, and stop.
        """
        if schema:
            return _print_schema()
        settings = list(set_ or [])
        if takes_file and file is None and settings and "=" not in settings[-1]:
            file = settings.pop()
        if takes_file and file is None:
            raise InvalidCase(f"{command}: needs a case file, as {command} FILE.yaml; see --help")
        if not takes_file and file is not None:
            raise InvalidCase(f"{command}: takes no file, got {file}; see --help")
        if resume and (force or from_ != STAGES[0]):
            raise InvalidCase("--resume: finds its stage itself; leave out --from and --force")
        options = RunOptions(
            preset, tuple(settings), out, force, from_, stop_after, threads, quiet, verbose, resume
        )
        return run(file, options)

    app.default(_run)
    return app


def _print_schema():
    import json

    from cases.json_schema import case_schema

    print(json.dumps(case_schema(), indent=2))
    return 0


def run_guarded(work: Callable[[], int | None]):
    """Call `work`; errors become one sentence on the standard error stream and an exit code."""
    previous = _on_terminate(_raise_terminated)
    Terminated.received = False
    try:
        return work() or 0
    except CycloptsError as error:
        return _fail(2, _first_sentence(error))
    except NotConverged as error:
        return _fail(1, str(error))
    except (InvalidCase, InvalidMesh) as error:
        return _fail(_code_of(error.__cause__), str(error))
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        return _fail(_code_of(error), f"{where}{error.strerror or error}")
    except MemoryError:
        return _fail(1, "out of memory; use a coarser mesh (mesh.edge_length or mesh.tets)")
    except Terminated:
        return _fail(143, "terminated; finished files are kept")
    except KeyboardInterrupt:
        return _fail(130, "interrupted; finished files are kept")
    finally:
        _on_terminate(previous)


def _code_of(cause):
    """1 where a file failed (a full disk), 2 where a wrong one was named."""
    wrong_name = FileNotFoundError | IsADirectoryError | NotADirectoryError | PermissionError
    return 1 if isinstance(cause, OSError) and not isinstance(cause, wrong_name) else 2


class Terminated(KeyboardInterrupt):
    """The process was asked to end (SIGTERM)."""

    received = False  # a stage that ends early on Ctrl-C may have caught it


def _raise_terminated(*_):
    Terminated.received = True
    raise Terminated


def _on_terminate(handler):
    """Set what SIGTERM does; None where signals cannot be set (another thread)."""
    try:
        return signal.signal(signal.SIGTERM, handler) if handler is not None else None
    except ValueError:
        return None


def _fail(code, text):
    for line in text.splitlines() or [""]:
        print(f"error: {line}", file=sys.stderr)
    return code


def _first_sentence(error):
    text = " ".join(str(error).split())
    return f"{text[:1].upper()}{text[1:]} See --help."


def set_threads(count):
    """Let numba and the linear algebra libraries use `count` threads; returns how many.

    Parameters
    ----------
    count : int or None
        None, and any number above it, means all cores.

    Raises
    ------
    InvalidCase
        If it is below 1.
    """
    import numba
    import threadpoolctl

    most = numba.config.NUMBA_NUM_THREADS
    if count is not None and count < 1:
        raise InvalidCase(f"--threads {count}: must be at least 1")
    count = most if count is None else min(count, most)
    numba.set_num_threads(count)
    threadpoolctl.threadpool_limits(count)
    threadpoolctl.threadpool_limits(1, user_api="blas")  # its threads would wait beside numba's
    return count


def _run_case(path, shown, options):
    from cases.pipeline import run_pipeline  # the stages take seconds to import

    return run_pipeline(path, shown, options)


def main(arguments=None):
    """`python -m cases FILE.yaml ...`; returns the exit code."""
    app = make_app("python -m cases", True, lambda file, options: _run_case(file, file, options))
    return _main(app, arguments)


def run_bundled(path, arguments=None):
    """`python -m cases.bridge ...` and its like; returns the exit code."""

    def run(_, options):
        return _run_case(path, path.name, options)

    return _main(make_app(f"python -m cases.{path.stem}", False, run), arguments)


def _main(app, arguments):
    tokens = sys.argv[1:] if arguments is None else list(arguments)
    return run_guarded(lambda: app(tokens, exit_on_error=False, print_error=False))
