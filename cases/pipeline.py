"""The whole line: the only place that sees every stage.

Each stage writes its files before the next one starts, and the manifest after each, so that
whatever happens leaves the finished stages on disk and says how far the run came.
"""

import contextlib
import os
import sys
import time
from dataclasses import replace
from pathlib import Path

from cases import report
from cases.cli import Terminated, set_threads
from cases.compile_ahead import CompileAhead
from cases.design_stages import MeshStage, TopoptStage
from cases.load import load_case
from cases.manifest import Manifest
from cases.memory import MemorySampler
from cases.pictures import make_pictures
from cases.problem import to_problem, units_warning
from cases.progress import make_reporter
from cases.remesh_stage import RemeshStage
from cases.resolved import resolved_case, write_case
from cases.run_folder import OUTPUT, STAGES, RunFolder, stages_done
from cases.run_log import LOG, RunLog
from cases.run_state import Run
from cases.surface_files import write_quality
from cases.surface_stages import IsosurfaceStage, SmoothStage
from meshes.errors import InvalidCase
from meshes.io import write_atomically
from topopt.boundary import check_problem

_STAGES = {
    "mesh": MeshStage(),
    "topopt": TopoptStage(),
    "isosurface": IsosurfaceStage(),
    "smooth": SmoothStage(),
    "remesh": RemeshStage(),
}


def run_pipeline(path, shown, options):
    """Run a case file as the command line's options say, and print its summary.

    Parameters
    ----------
    path : str or Path
    shown : str
        What the file is called in messages.
    options : RunOptions

    Raises
    ------
    InvalidCase, InvalidMesh, NotConverged
        With one sentence each; the manifest has it too.
    KeyboardInterrupt
        After what was finished has been written.
    """
    if STAGES.index(options.first) > STAGES.index(options.last):
        raise InvalidCase(
            f"--from {options.first}: comes after --stop-after {options.last}; nothing is to do"
        )
    loaded = load_case(path, options.preset, options.settings, shown)
    problem = to_problem(loaded)
    check_problem(problem)
    threads = set_threads(options.threads)
    folder = RunFolder(options.out or Path("runs") / loaded.case.name)
    tree = resolved_case(loaded)
    if options.resume:
        first = folder.unfinished_stage(tree, options.last)
        if first is None:
            _repeat_summary(folder, options)
            return
        options = replace(options, first=first)
    earlier = _earlier_stages(folder, options.first)
    folder.prepare(tree, options.first, options.force, options.resume)
    write_case(folder / "case.yaml", tree, shown, loaded.preset)
    reporter = make_reporter(options.quiet, options.verbose)
    run = Run(loaded, problem, folder.path, reporter, resume=options.resume)
    facts = {
        "case": loaded.case.name,
        "preset": loaded.preset,
        "file": shown,
        "command": sys.argv,
        "seed": loaded.case.seed,
        "threads": threads,
    }
    with (
        contextlib.closing(reporter),
        RunLog(folder / "run.log", reporter, append=bool(earlier) or options.resume) as log,
        MemorySampler() as memory,
        contextlib.closing(CompileAhead(loaded.case.mesh.kind, options.last, threads)) as ahead,
    ):
        manifest = Manifest(folder / "manifest.json", facts, earlier)
        manifest.data["warnings"] = log.warnings
        with _outcome(manifest):
            if units_warning(problem):
                LOG.warning("%s", units_warning(problem))
            _run_stages(run, options, manifest, memory, ahead)
            summary = _finish(run, options, manifest, memory)
    if not options.quiet:
        print(summary)


def _repeat_summary(folder, options):
    """Nothing is left to do: print what the finished run said."""
    if not options.quiet:
        print(f"{folder.path}: is finished; nothing is to do", file=sys.stderr)
        with contextlib.suppress(OSError):
            print((folder / "summary.txt").read_text(encoding="utf-8"), end="")


def _earlier_stages(folder, first):
    """The manifest's records of the stages before `first` from the run whose files are reused."""
    done = stages_done(folder / "manifest.json")
    return {name: done[name] for name in STAGES[: STAGES.index(first)] if name in done}


@contextlib.contextmanager
def _outcome(manifest):
    """Write into the manifest how the run ended, whatever happens."""
    try:
        yield
    except KeyboardInterrupt:
        manifest.finish("terminated" if Terminated.received else "interrupted")
        raise Terminated if Terminated.received else KeyboardInterrupt from None
    except BaseException as error:
        with contextlib.suppress(Exception):  # a full disk must not hide the reason
            manifest.finish(f"failed: {error or type(error).__name__}")
        raise


def _run_stages(run, options, manifest, memory, ahead):
    """Load the stages before --from, run the others up to --stop-after."""
    for name in STAGES[: STAGES.index(options.last) + 1]:
        stage = _STAGES[name]
        if ahead.running(name):
            LOG.info("waiting for the kernels of stage %s, which the first run compiles", name)
            ahead.wait(name)
        if STAGES.index(name) < STAGES.index(options.first):
            stage.load(run)
        else:
            with _measured(name, run, manifest, memory):
                run.reporter.begin(name)
                text = stage.run(run)
            LOG.info("%s: %s", name, text)
            run.reporter.end(text)
        manifest.data["mesh"] = run.figures["mesh"]
    manifest.write()


@contextlib.contextmanager
def _measured(name, run, manifest, memory):
    """Record seconds and peak memory of a stage when it is done."""
    memory.take_peak()
    wall, processor = time.perf_counter(), _processor_seconds()
    yield
    manifest.stage_done(
        name,
        time.perf_counter() - wall,
        _processor_seconds() - processor,
        memory.take_peak(),
        run.figures.get(name, {}),
    )


def _processor_seconds():
    """Processor time [s] of this process and the children it has waited for."""
    return sum(os.times()[:4])


def _finish(run, options, manifest, memory):
    """Quality, pictures and summary; returns the summary's text."""
    with _measured(OUTPUT, run, manifest, memory):
        run.reporter.begin(OUTPUT)
        figures = report.quality(run)
        if figures:
            write_quality(run.folder / "quality.json", figures)
        if run.case.output.pictures:
            problem = make_pictures(run.folder)
            if problem:
                LOG.warning("%s", problem)
        run.reporter.end(f"files in {run.folder}")
    summary = report.summary(run, figures, manifest.data)
    write_atomically(run.folder / "summary.txt", summary + "\n")
    done = options.last == STAGES[-1]
    manifest.finish("finished" if done else f"stopped after {options.last}")
    return summary
