"""The state of a page: its study, the command that runs, and what is sent to every browser that watches."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path

from gsid.base.errors import InputError
from gsid.records.files import columns_of
from gsid.study.folder import Step, Study
from gsid.webpage.actions import ACTIONS
from gsid.webpage.edits import step_command, unedited
from gsid.webpage.jobs import Job
from gsid.webpage.words import CRITERION, GOOD, INTERRUPTED, Outcome, followups_of, outcome_of

FOLLOW_S = 1.0  # between two looks at what other commands have changed
MAX_UPLOAD = 200 << 20
WITH_ANSWER = ("diagnose", "next")  # steps of which the page reads more than sentences
COMING = {"command": "", "step": "the next step is about to begin", "verb": "", "stopping": False}
GOOD_ENDS = (GOOD, CRITERION, INTERRUPTED)


def title_of(step: Step) -> str:
    """The words above a step: those of its button, if the page has one."""
    action = ACTIONS.get(step.verb)
    return action.title if action else step.verb


def made_by(step: Step) -> str | None:
    """The model that a step wrote."""
    return next((name for name in reversed(step.outputs) if name.startswith("models/")), None)


def base_of(step: Step) -> str | None:
    """The model that a step started from."""
    words = step.arguments
    return unedited(words[words.index("--model") + 1]) if "--model" in words[:-1] else None


class Page:
    """The state of one page: its study, and the command that runs.

    Parameters
    ----------
    study : Study
    max_upload : int
        Largest file that is accepted [bytes].
    """

    def __init__(self, study: Study, max_upload: int = MAX_UPLOAD) -> None:
        self.study, self.max_upload = study, max_upload
        self.job: Job | None = None
        self.error: str | None = None  # of the server itself, while it ran or recorded a step
        self.outputs: list[str] = []
        self.number = 0  # of the step that runs
        self._followups: dict[int, Outcome] = {}  # of each step, as its answer in the study has them
        self.watchers: set[asyncio.Event] = set()
        self._columns: dict[str, list[str]] = {}  # of each record
        self._running: asyncio.Task | None = None
        self._is_closing = False
        self._reserved: asyncio.Task | None = None  # which is about to begin a step
        self._n_stops = 0
        self._n_readings, self._shown_reading = 0, 0
        self.is_stopped = False  # since the last step began, even if it had ended: what follows is not begun
        self._study = self._study_state()

    # ---- what is shown -------------------------------------------------------------------------------

    def state(self) -> dict:
        """Everything that the page shows, except the pictures."""
        return self._study | {
            "job": self._shown_job(),
            "error": self.error,
            "actions": {verb: vars(action) for verb, action in ACTIONS.items()},
        }

    def _study_state(self) -> dict:
        """The part that only a new file or a new step changes: each line of progress sends it again."""
        steps = self.study.steps
        records = sorted(name for name in self.study.files if name.startswith("records/"))
        return {
            "folder": self.study.folder.name,
            "records": records,
            "columns": {name: self._columns_of(name) for name in records},
            "models": self.study.models,
            "steps": [self._shown(one) for one in steps],
        }

    def _columns_of(self, record: str) -> list[str]:
        """Names of its columns; empty for a file that cannot be read: the next step has its error."""
        if record not in self._columns:
            try:
                self._columns[record] = columns_of(self.study.path(record))
            except (InputError, OSError, ImportError):
                self._columns[record] = []
        return self._columns[record]

    def _shown(self, step: Step) -> dict:
        if step.number not in self._followups:
            self._followups[step.number] = followups_of(step.verb, self.study.answer(step))
        own = {
            "number": step.number,
            "verb": step.verb,
            "title": title_of(step),
            "command": step.command,
            "words": step.words,
        }
        own |= {"records": [word for word in step.arguments if word.startswith("records/")]}
        own |= {"files": [name for name in step.outputs if name != step.picture]}
        more = {"effects": self._followups[step.number].effects, "next": self._followups[step.number].next}
        failed = step.exit_code not in GOOD_ENDS
        models = {"model": made_by(step), "base": base_of(step)}
        models |= {"answer": step.answer if step.verb in WITH_ANSWER else ""}
        return own | more | models | {"failed": failed, "picture": step.picture or None}

    def _shown_job(self) -> dict | None:
        """The step that runs, or that one is about to begin: None only if a step may be requested."""
        job = self.job
        if job is None:
            return None if self._reserved is None else COMING
        return {
            "command": job.command,
            "step": job.step,
            "verb": job.arguments[0],
            "stopping": job.is_stopping,
        }

    def read_study(self) -> None:
        """Show the study as its folder has it now."""
        self._store(self._next_reading(), self._study_state())
        self.changed()

    async def _read_in_thread(self) -> None:
        number = self._next_reading()
        self._store(number, await asyncio.to_thread(self._study_state))

    def _next_reading(self) -> int:
        self._n_readings += 1
        return self._n_readings

    def _store(self, number: int, found: dict) -> None:
        """Keep a state, unless one whose reading began later is there."""
        if number > self._shown_reading:
            self._study, self._shown_reading = found, number

    def changed(self) -> None:
        """Have the state sent to every page that watches, when it next reads."""
        for watcher in self.watchers:
            watcher.set()

    # ---- what is done --------------------------------------------------------------------------------

    async def request_step(self, wanted: dict) -> None:
        """Begin the step that the page asks for. The server goes on while another command writes the study.

        Raises
        ------
        InputError
            Another one runs, the request is not understood, or it was stopped before it began.
        """
        with self.reserved():
            n_stops = self._n_stops
            number, arguments, outputs = await asyncio.to_thread(step_command, self.study, wanted)
            if self._n_stops > n_stops:
                await asyncio.to_thread(self._withdraw, number, outputs)
                raise InputError("the step was stopped before it began")
            self.begin(Job(tuple(arguments)), outputs, number)

    def _withdraw(self, number: int, outputs: list[str]) -> None:
        """Give back the number of a step that is not begun, without the model that was saved for it."""
        for name in outputs:
            (self.study.folder / name).unlink(missing_ok=True)
        self.study.cancel_step(number)

    def check_idle(self) -> None:
        """Raise InputError if a step runs or is about to begin, or the server ends."""
        if self._is_closing:
            raise InputError("the server is ending")
        if self.job is not None:
            raise InputError("another step is running", "", self.job.arguments[0], "wait, or stop it")
        if self._reserved not in (None, asyncio.current_task()):
            raise InputError("another step is about to begin", "", None, "wait, or stop it")

    @contextlib.contextmanager
    def reserved(self) -> Iterator[None]:
        """Let only this task begin a step. Every page shows it, so that no button is pressed in vain.

        Raises
        ------
        InputError
            As `check_idle`.
        """
        self.check_idle()
        own, before = asyncio.current_task(), self._reserved
        self._reserved = own
        self.changed()
        try:
            yield
        finally:
            if self._reserved is own:
                self._reserved = before
                self.changed()

    def begin(
        self, job: Job, outputs: list[str], number: int, then: Callable[[Job], Awaitable[None]] | None = None
    ) -> None:
        """Begin a step.

        Parameters
        ----------
        job : Job
        outputs : list of str
            Files that it may write.
        number : int
            From `Study.begin_step`.
        then : callable, optional
            Called when the step has ended and is noted.

        Raises
        ------
        InputError
            Another one runs.
        """
        self.check_idle()
        self.number, self.outputs, self.job, self.error = number, outputs, job, None
        self.is_stopped, self._reserved = False, None
        self._running = asyncio.create_task(self._run(job, then))
        self.changed()

    async def _run(self, job: Job, then: Callable[[Job], Awaitable[None]] | None) -> None:
        try:
            try:
                await job.run(self.study.folder, self.changed)
            finally:
                if job.exit_code is not None:
                    await self._record(job)
        except Exception as error:
            self.error = f"{job.command}: {type(error).__name__}: {error}"
        finally:
            self.job = None
            if then is not None and not self._is_closing:
                await self._follow_up(then, job)
            self.changed()

    async def _follow_up(self, then: Callable[[Job], Awaitable[None]], job: Job) -> None:
        try:
            with self.reserved():
                await then(job)
        except Exception as error:
            self.error = str(error) if isinstance(error, InputError) else f"{type(error).__name__}: {error}"

    async def _record(self, job: Job) -> None:
        """Note the step; an answer that cannot be read does not lose it."""
        verb, exit_code = job.arguments[0], job.exit_code
        try:
            found = outcome_of(verb, exit_code, job.stdout, job.messages, stopped=job.is_stopping)
        except Exception as error:
            text = f"The answer of the command cannot be read: {type(error).__name__}: {error}"
            found = Outcome((text, *job.messages))
        await asyncio.to_thread(
            self.study.add_step,
            job.arguments,
            exit_code,
            words=found.sentences,
            outputs=self.outputs,
            answer=job.stdout,
            number=self.number,
        )
        await self._read_in_thread()

    async def follow(self) -> None:
        """Show what other commands change in the study, until it is cancelled."""
        known = self.study.stamp
        while True:
            await asyncio.sleep(FOLLOW_S)
            if self.study.stamp == known:
                continue
            known = self.study.stamp
            with contextlib.suppress(InputError, OSError):  # the next request reports it
                await self._read_in_thread()
                self.changed()

    async def add_file(self, source: Path, name: str, with_last: bool = False) -> str:
        """Copy a record into the study.

        Parameters
        ----------
        source : Path
        name : str
            Name in the study.
        with_last : bool
            Whether it belongs to the last experiment; otherwise it is a new one.

        Returns
        -------
        str
            Path in the study.
        """
        experiment = "last" if with_last else "new"
        kept = await asyncio.to_thread(self.study.add_file, source, name, experiment=experiment)
        await self._read_in_thread()
        self.changed()
        return kept

    def stop(self) -> None:
        """Stop the step that runs; it keeps what it has found."""
        self.is_stopped = True
        self._n_stops += 1
        if self.job is not None:
            self.job.stop()
            self.changed()

    async def close(self) -> None:
        """Stop what runs, and note it, when the server ends."""
        self._is_closing = True
        if self._running is None or self._running.done():
            return
        if self.job is not None:
            self.job.stop()
            await asyncio.wait([self._running], timeout=self.job.close_s)
        if self.job is not None:
            self.job.kill()
        await asyncio.wait([self._running])
