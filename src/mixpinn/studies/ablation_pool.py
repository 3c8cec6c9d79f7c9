"""Runs the trainings of a table as independent jobs: in processes of this machine or on a Dask scheduler's workers."""

import contextlib
import multiprocessing
import os
import threading
import time
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from mixpinn.base.child_process import Patience, end_all, script_left_alone
from mixpinn.base.errors import InputError, MixpinnError
from mixpinn.base.files import write_text
from mixpinn.base.progress import progress_bar, quiet
from mixpinn.dataset.local_pool import deaf_to_interrupts, hear_interrupts, pinned_threads
from mixpinn.studies.ablation_config import STANDSTILL
from mixpinn.studies.ablation_jobs import EVALUATIONS, MODELS_FOLDER, AblationJob, run_job, test_set_names

POLL_SECONDS = 0.5
BEAT_SECONDS = 1.0
MESSAGE = "error.txt"


def epochs_done(folder: Path, job: AblationJob) -> int:
    """Complete epochs of a job, read from its loss curve."""
    history = folder / MODELS_FOLDER / job.name / "history.csv"
    with contextlib.suppress(OSError):
        return max(0, history.read_text().count("\n") - 1)
    return 0


def is_done(folder: Path, job: AblationJob) -> bool:
    """Whether every test set of a job has its metrics and the job left no error."""
    evaluations = folder / EVALUATIONS / job.name
    return all((evaluations / f"{name}.json").exists() for name in test_set_names(folder))


def run_jobs(
    jobs: Sequence[AblationJob], folder: Path, *, workers: int, threads: int, scheduler: str | None = None,
    devices: int = 1, timeout: float = STANDSTILL,
) -> dict[str, str]:
    """Run every job that is not finished; a job that fails leaves the others alone.

    Args:
        jobs: in the order in which they are begun.
        folder: of the table, visible to all workers under the same path.
        workers: processes on this machine; not used with a scheduler.
        threads: of each process.
        scheduler: address of a Dask scheduler.
        devices: processes of each training, each with a device of its own.
        timeout: a job's process on this machine that stands still for so long is ended [s].

    Returns:
        The message of each job that failed, by name.

    Raises:
        InputError: the scheduler does not answer.
    """
    open_jobs = [job for job in jobs if not is_done(folder, job)]
    failed: dict[str, str] = {}
    events = (
        _on_dask(open_jobs, folder, scheduler=scheduler, devices=devices) if scheduler
        else _local(open_jobs, folder, workers=workers, threads=threads, devices=devices, timeout=timeout)
    )
    # Progress is counted in samples that pass, since rows differ in their epochs.
    total = sum(job.train.max_epochs for job in jobs)
    with progress_bar() as bar, contextlib.closing(events):
        done = len(jobs) - len(open_jobs)
        ended = {job.name for job in jobs} - {job.name for job in open_jobs}
        task = bar.add_task(f"ablate: run {done} of {len(jobs)}, epochs", total=total)
        for event in events:
            if event is not None:
                name, message = event
                done += 1
                ended.add(name)
                if message:
                    failed[name] = message
            passed = sum(
                job.train.max_epochs if job.name in ended else epochs_done(folder, job) for job in jobs
            )
            bar.update(task, completed=passed, description=f"ablate: run {done} of {len(jobs)}, epochs")
    return failed


def _local(
    jobs: Sequence[AblationJob], folder: Path, *, workers: int, threads: int, devices: int, timeout: float,
) -> Generator[tuple[str, str] | None, None, None]:
    """A process a job, so many at a time; yields what ended, and None now and then."""
    context = multiprocessing.get_context("spawn")
    waiting, running = list(jobs), dict[str, _Run]()
    patience: Patience[str] = Patience(timeout)
    try:
        while waiting or running:
            while waiting and len(running) < workers:
                job = waiting.pop(0)
                here, there = context.Pipe(duplex=False)
                process = context.Process(target=work, args=(job, folder, devices, there))
                with pinned_threads(threads), deaf_to_interrupts(), script_left_alone():
                    process.start()
                there.close()
                running[job.name] = _Run(process, here)
            time.sleep(POLL_SECONDS)
            for name, run in list(running.items()):
                if run.beats():
                    patience.heard(name)
                if not run.process.is_alive():
                    yield name, _reason(folder, name, run.end())
                    del running[name]
            for name in patience.lost(dict.fromkeys(running, timeout)):
                run = running.pop(name)
                run.process.kill()
                run.end()
                yield name, f"its process stood still for {timeout:g} s and was ended; the same command continues it"
            yield None
    finally:
        end_all(run.process for run in running.values())
        for run in running.values():
            run.end()


@dataclass(frozen=True, eq=False)
class _Run:
    """A job's process, and the connection on which it shows now and then that it runs."""

    process: Any
    connection: Connection

    def beats(self) -> bool:
        """Whether there was a sign of life since this was last asked."""
        heard = False
        with contextlib.suppress(EOFError, OSError):
            while self.connection.poll():
                self.connection.recv()
                heard = True
        return heard

    def end(self) -> int | None:
        """Exit code of the ended process."""
        self.process.join()
        self.connection.close()
        code: int | None = self.process.exitcode
        return code


def _reason(folder: Path, name: str, code: int | None) -> str:
    """Why a job failed, empty where it did not."""
    if code == 0:
        return ""
    message = folder / MODELS_FOLDER / f"{name}.{MESSAGE}"
    return message.read_text().strip() if message.exists() else f"its process ended with code {code}"


def work(job: AblationJob, folder: Path, devices: int, parent: Connection) -> None:
    """What a worker process does; a failure that a user can mend is left in a file as one line."""
    threading.Thread(target=_beat, args=(parent,), daemon=True).start()
    message = folder / MODELS_FOLDER / f"{job.name}.{MESSAGE}"
    try:
        hear_interrupts()  # processes of its own must hear them
        message.unlink(missing_ok=True)
        with quiet():
            run_job(job, folder, devices=devices)
    except MixpinnError as error:
        write_text(message, f"{error}\n")
        raise SystemExit(2) from error
    except KeyboardInterrupt:  # control-C reaches every process; the parent says what it means
        raise SystemExit(130) from None


def _beat(parent: Connection) -> None:
    """Show the parent that this process runs; end it when the parent is gone, for a resumed table needs its folders.

    By a thread of its own, since the process may have children that must not be killed before they have ended.
    """
    while True:
        try:
            parent.send(None)
        except OSError:
            os._exit(1)
        time.sleep(BEAT_SECONDS)


def _on_dask(
    jobs: Sequence[AblationJob], folder: Path, *, scheduler: str, devices: int,
) -> Generator[tuple[str, str] | None, None, None]:
    from mixpinn.dataset import connect_dask

    folder = folder.resolve()  # workers have working directories of their own
    with connect_dask(scheduler) as client:
        futures = {
            job.name: client.submit(_work_quietly, job, folder, devices, key=f"{folder}:{job.name}", pure=False)
            for job in jobs
        }
        try:
            while futures:
                time.sleep(POLL_SECONDS)
                for name, future in list(futures.items()):
                    if future.done():
                        del futures[name]
                        error = future.exception()
                        if error is not None and not isinstance(error, MixpinnError):
                            yield name, f"{type(error).__name__}: {error}"
                        else:
                            yield name, "" if error is None else str(error)
                yield None
        finally:
            client.cancel(list(futures.values()))


def _work_quietly(job: AblationJob, folder: Path, devices: int) -> None:
    with quiet():
        run_job(job, folder, devices=devices)


def check_scheduling(*, workers: int, devices: int) -> None:
    """Refuse numbers that make no sense.

    Raises:
        InputError: fewer than one worker or device.
    """
    for name, value in (("workers", workers), ("devices", devices)):
        if value < 1:
            raise InputError(name, expected="at least 1", got=str(value), fix="correct the setting")
