"""The panel's pages and actions."""

from __future__ import annotations

import asyncio
import json
import re
from collections.abc import Callable, Collection
from html import escape
from importlib.resources import files
from pathlib import Path
from threading import Lock
from typing import Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import (
    FileResponse,
    HTMLResponse,
    JSONResponse,
    Response,
    StreamingResponse,
)
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from station import registry
from station.clock import boot_seconds
from station.errors import StationError, reason_of
from station.panel.access import GUESS_EVERY_S, Access, Guard, Role, Turns, cookie_of, peer_of
from station.panel.figures import figure_of
from station.panel.overview import MAX_RUNS, benches, counts, device, plans
from station.panel.run_requests import REQUESTS, RunRequests
from station.panel.starting import Starting, Wanted
from station.panel.translating import ANSWER, ERROR, HOME, LOOK, OF_RESULTS, translated
from station.panel.watching import RunWatch, Streams
from station.parts import parts_of_text
from station.plots import Plot
from station.record.files import is_own_file
from station.record.layout import EVENTS
from station.record.run_list import first_event, newest_runs
from station.record.verification import refuse_unproven
from station.texts import ENGLISH, FLAGS, PANEL, Texts, catalogue, languages, preferred, tag

PAGES = Path(__file__).parent / "pages"
PLOTLY = Path(str(files("plotly"))) / "package_data"
LANGUAGE_COOKIE = "station-language"
REPORT, RESULTS, PLOTS = "report.html", "results.json", "plots.json"
MANY_RUNS = 200
"""For the yield of a plan."""
SEEN_FOR_S = 1.5
"""Real time for which a look at benches and runs is shown; the page asks every 2 s."""
REPORT_POLICY = "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:"
BACK = "Benches and runs"
SENTENCE = """<!doctype html>
<html lang="{language}"><head><meta charset="utf-8"><title>Inertial Station</title>
<meta name="viewport" content="width=device-width, initial-scale=1"><link rel="icon" href="data:,">
<link rel="stylesheet" href="/static/panel.css"></head><body class="first"><main>
<h1>Inertial Station</h1><p class="notice">{sentence}</p>
<p><a class="button" href="/">{back}</a></p>
</main></body></html>
"""
PICTURE = re.compile(r"[a-z0-9-]+\.(svg|png)")


class Panel:
    """The runs below a folder, and what a browser may see and ask of them."""

    def __init__(self, runs: Path, access: Access, starting: Starting) -> None:
        self._runs = runs
        self._starting = starting
        self._access = access
        self._watched: dict[str, RunWatch] = {}
        self._wishes = RunRequests()
        self._streams = Streams()
        self._lock = Lock()
        self._turns = Turns()
        self._looks = Lock()
        self._seen: tuple[float, tuple[str, ...], dict[str, Any]] = (float("-inf"), (), {})

    def app(self) -> Starlette:
        """Return the application."""
        routes = [
            Route("/", page("home.html")),
            Route("/run/{run}", self.run_page),
            Route("/login", self.log_in, methods=["POST"]),
            Route("/api/home", self.home),
            Route("/api/device", self.device),
            Route("/api/look", self.look, methods=["POST"]),
            Route("/api/start", self.start, methods=["POST"]),
            Route("/api/run/{run}/events", self.events),
            Route("/api/run/{run}/results", self.results),
            Route("/api/run/{run}/report", self.report),
            Route("/api/run/{run}/certificate", self.certificate),
            Route("/api/run/{run}/plots", self.plots),
            Route("/api/run/{run}/picture/{name}", self.picture),
            Route("/api/run/{run}/resume", self.resume, methods=["POST"]),
            Route("/api/run/{run}/{wish}", self.wish, methods=["POST"]),
            Route("/static/plotly.min.js", plotly),
            Route("/static/texts.js", texts),
            Mount("/static", StaticFiles(directory=PAGES)),
        ]
        guard = Middleware(Guard, access=self._access)
        handlers = {StationError: refused, 404: no_page}
        return Starlette(routes=routes, middleware=[guard], exception_handlers=handlers)

    def folder(self, request: Request) -> Path:
        """Return the folder of the run that a path names; raises StationError without one."""
        name: str = request.path_params["run"]
        folder = self._runs / name
        if not is_own_file(folder / EVENTS) or name.startswith("."):
            raise StationError("there is no such run")
        if folder.resolve().parent != self._runs.resolve():
            raise StationError("there is no such run")
        return folder

    def role(self, request: Request) -> Role:
        """Return the role of who asks; the guard has let nobody without one through."""
        return self._access.role_of(request) or "operator"

    def watch(self, folder: Path) -> RunWatch:
        """Return what all viewers of a run share."""
        with self._lock:
            return self._watched.setdefault(folder.name, RunWatch(folder))

    def run_page(self, request: Request) -> Response:
        """Return the page of a run."""
        self.folder(request)
        return FileResponse(PAGES / "run.html")

    async def log_in(self, request: Request) -> Response:
        """Take a token and give a session."""
        token = str((await body(request)).get("token", ""))
        peer = peer_of(request)
        wait_s = self._turns.take(peer, boot_seconds())
        if wait_s is None:
            wait = {"error": "too many wrong tokens came from this computer; wait"}
            return said(request, wait, ERROR, 429)
        await asyncio.sleep(wait_s)
        logged_in = self._access.log_in(token)
        if logged_in is None:
            await asyncio.sleep(GUESS_EVERY_S)
            return said(request, {"error": "this token is not known here"}, ERROR, 403)
        self._turns.was_right(peer)
        session, role = logged_in
        response = JSONResponse({"role": role})
        response.set_cookie(cookie_of(request), session, httponly=True, samesite="strict")
        return response

    async def home(self, request: Request) -> Response:
        """Return benches, plans and runs."""
        if self._access.role_of(request) is None:
            return JSONResponse({"error": "log in first"}, 401)

        role, asked = self.role(request), request.query_params
        search, plan = asked.get("search", "")[:200], asked.get("plan", "")[:200]
        overview = await run_in_threadpool(self.overview, search, plan, role)
        return said(request, {"role": role, **overview}, HOME)

    def overview(self, search: str, plan: str, role: Role) -> dict[str, Any]:
        """Return benches, plans and runs; one look at the files does for all who ask at once."""
        asked = search, plan, role
        with self._looks:
            seen_s, seen_for, seen = self._seen
            if seen_for != asked or boot_seconds() - seen_s > SEEN_FOR_S:
                newest = newest_runs(self._runs, most=MANY_RUNS)
                runs = newest_runs(self._runs, search, MAX_RUNS) if search else newest[:MAX_RUNS]
                seen = {
                    "benches": benches(newest),
                    "plans": plans(role),
                    "runs": runs,
                    "today": counts(newest, plan),
                }
                self._seen = boot_seconds(), asked, seen
            return seen

    async def device(self, request: Request) -> Response:
        """Return how the results of a device went from run to run."""
        serial = request.query_params.get("serial", "")[:200]
        trends = await run_in_threadpool(device, self._runs, serial)
        return said(request, trends, OF_RESULTS)

    async def resume(self, request: Request) -> Response:
        """Go on with a run that ended before its end."""
        folder = self.folder(request)
        await run_in_threadpool(self._starting.resume, folder, self.role(request))
        return JSONResponse({"run": folder.name})

    async def look(self, request: Request) -> Response:
        """Return what a run would do."""
        wanted = Wanted.of(await body(request))
        looked = await run_in_threadpool(self._starting.look, wanted, self.role(request))
        return said(request, looked, LOOK)

    async def start(self, request: Request) -> Response:
        """Begin a run."""
        wanted = Wanted.of(await body(request))
        run = await run_in_threadpool(self._starting.start, wanted, self.role(request))
        return JSONResponse({"run": run})

    async def events(self, request: Request) -> Response:
        """Return the news of a run as server-sent events, for as long as the browser listens."""
        watch, texts = self.watch(self.folder(request)), Texts(language_of(request))
        news = self._streams.news(request, watch, texts)
        return StreamingResponse(news, media_type="text/event-stream")

    def results(self, request: Request) -> Response:
        """Return the results of a run."""
        path = self.folder(request) / RESULTS
        if not is_own_file(path):
            return JSONResponse({"error": "this run has no results"}, 404)
        refuse_unproven(path.parent)
        if language_of(request) == ENGLISH:
            return FileResponse(path, media_type="application/json")
        data = json.loads(path.read_text(encoding="utf-8"))
        titles = catalogue(language_of(request), FLAGS)
        for flag in data["flags"]:
            flag["title"] = titles.get(flag["code"], "")
        return said(request, data, OF_RESULTS)

    def report(self, request: Request) -> Response:
        """Return the report of a run, which may run nothing."""
        path = self.folder(request) / REPORT
        if not is_own_file(path):
            return refusal(request, "this run has no report", 404)
        refuse_unproven(path.parent, REPORT)
        return FileResponse(path, headers={"Content-Security-Policy": REPORT_POLICY})

    def certificate(self, request: Request) -> Response:
        """Return the certificate of a run as PDF, made now; a draft says why it is one."""
        folder = self.folder(request)
        made = self._starting.certificate(folder, language_of(request))
        return FileResponse(made, media_type="application/pdf")

    def plots(self, request: Request) -> Response:
        """Return the plots of a run's procedure, each as a Plotly figure with its sentences."""
        path = self.folder(request) / PLOTS
        if not is_own_file(path):
            return JSONResponse({"error": "this run has no plots"}, 404)
        refuse_unproven(path.parent, PLOTS)
        texts = Texts(language_of(request))
        try:
            parts = parts_of_text(path.read_text(encoding="utf-8"))
        except ValueError as error:
            raise StationError(f"{PLOTS} cannot be read: {reason_of(error)}") from error
        drawn = [
            {
                "title": texts(part.title),
                "caption": texts(part.caption),
                "figure": figure_of(part, texts),
            }
            for part in parts
            if isinstance(part, Plot)
        ]
        return JSONResponse(drawn)

    def picture(self, request: Request) -> Response:
        """Return a picture of the run's procedure; nothing outside its pictures is readable."""
        procedure = str(first_event(self.folder(request)).get("procedure"))
        package = registry.folder_of(registry.PROCEDURES, procedure)
        name = request.path_params["name"]
        path = package / "pictures" / name if package and PICTURE.fullmatch(name) else None
        if path is None or not path.is_file():
            return JSONResponse({"error": "there is no such picture"}, 404)
        return FileResponse(path, headers={"Content-Security-Policy": REPORT_POLICY})

    async def wish(self, request: Request) -> Response:
        """Pass a wish on to the run's process: pause, go on, abort, or the answer to a prompt."""
        wish = request.path_params["wish"]
        if wish not in REQUESTS:
            return JSONResponse({"error": f"no such action: {wish}"}, 404)
        folder, data = self.folder(request), await body(request)
        details = {key: str(value)[:1000] for key, value in data.items() if key in ("id", "text")}
        details["by"] = f"the panel's abort ({self.role(request)} at {peer_of(request)})"
        word = await run_in_threadpool(self._wishes.pass_on, folder, wish, details)
        return said(request, word, ANSWER)


async def body(request: Request) -> dict[str, Any]:
    """Return the mapping that a request carries; raises StationError."""
    try:
        data = json.loads(await request.body())
    except (ValueError, RecursionError):
        data = None
    if not isinstance(data, dict):
        raise StationError("an action is a JSON mapping")
    return data


def said(request: Request, data: Any, names: Collection[str], status: int = 200) -> Response:
    """Return data with what stands under some names in the language of whoever asks."""
    return JSONResponse(translated(data, Texts(language_of(request)), names), status)


def page(name: str) -> Callable[[Request], Response]:
    """Return the endpoint of a page."""
    return lambda _: FileResponse(PAGES / name)


def texts(request: Request) -> Response:
    """Return the texts of the page's language."""
    language = language_of(request)
    values = {"TEXTS": catalogue(language, PANEL), "LANGUAGE": language, "LANGUAGES": languages()}
    values["TAG"] = tag(language)
    lines = [f"const {name} = {json.dumps(value)};" for name, value in values.items()]
    return Response("\n".join(lines), media_type="text/javascript")


def language_of(request: Request) -> str:
    """Return the language chosen on the page, else that of the browser's preference."""
    language = request.cookies.get(LANGUAGE_COOKIE, "")
    if language in languages():
        return language
    return preferred(request.headers.get("accept-language", ""))


def plotly(_: Request) -> Response:
    """Return the plotting library out of the installed package."""
    return FileResponse(PLOTLY / "plotly.min.js", headers={"Cache-Control": "max-age=86400"})


def refused(request: Request, error: Exception) -> Response:
    """Return a sentence that says what is wrong."""
    return refusal(request, str(error), 409)


def no_page(request: Request, _: Exception) -> Response:
    """Return that an address leads nowhere."""
    return refusal(request, "there is no such page", 404)


def refusal(request: Request, sentence: str, status: int) -> Response:
    """Return a sentence as data, or as a page to a person who opened an address."""
    if "text/html" not in request.headers.get("accept", ""):
        return said(request, {"error": sentence}, ERROR, status)
    language = language_of(request)
    back = catalogue(language, PANEL).get(BACK, BACK)
    words = {"language": language, "back": back, "sentence": Texts(language)(sentence)}
    escaped = {name: escape(word) for name, word in words.items()}
    return HTMLResponse(SENTENCE.format_map(escaped), status)
