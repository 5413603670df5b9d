"""A headless Chromium, told what to do over its DevTools protocol."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import json
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Any, TypeVar

T = TypeVar("T")
NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
OPTIONS = ("--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking")
WAIT = 60.0  # s, for it to start, and for each answer


def found() -> str | None:
    """The program, if there is one."""
    return next(filter(None, map(shutil.which, NAMES)), None)


class Tab:
    """One open page."""

    def __init__(self, socket: Any) -> None:
        """`socket` is the page's of the DevTools protocol."""
        self._socket, self._count = socket, 0

    async def call(self, method: str, **parameters: Any) -> Any:
        """What a method of the protocol answers.

        Raises:
            RuntimeError: it refuses.
        """
        self._count += 1
        await self._socket.write_message(json.dumps({"id": self._count, "method": method, "params": parameters}))
        while True:
            message = json.loads(await asyncio.wait_for(self._socket.read_message(), WAIT))
            if message.get("id") == self._count:
                if "error" in message:
                    raise RuntimeError(message["error"]["message"])
                return message["result"]

    async def value(self, script: str) -> Any:
        """What an expression of JavaScript, or the promise that it is, comes to.

        Raises:
            RuntimeError: it throws.
        """
        answer = await self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in answer:
            raise RuntimeError(answer["exceptionDetails"]["exception"].get("description", "it threw"))
        return answer["result"].get("value")

    async def until(self, script: str, seconds: float = WAIT) -> Any:
        """What an expression comes to once that is true.

        Raises:
            TimeoutError: it is not in time.
        """
        value = None
        async with asyncio.timeout(seconds):
            while not value:
                with contextlib.suppress(RuntimeError):  # a page on its way has nothing to ask yet
                    value = await self.value(script)
                await asyncio.sleep(0.0 if value else 0.05)
        return value

    async def go(self, address: str) -> None:
        """Open another address, and wait until it is there."""
        await self.call("Page.navigate", url=address)
        ready = f"location.href == {json.dumps(address)} && document.readyState == 'complete'"
        try:
            await self.until(ready)
        except TimeoutError as error:
            raise TimeoutError(f"{address} is not there in time") from error

    async def key(self, name: str) -> None:
        """Press a key and let go of it."""
        code = {"ArrowRight": 39, "ArrowLeft": 37}[name]
        for kind in ("keyDown", "keyUp"):
            await self.call("Input.dispatchKeyEvent", type=kind, key=name, code=name, windowsVirtualKeyCode=code)

    async def picture(self) -> bytes:
        """The page as it is seen, a PNG."""
        return base64.b64decode((await self.call("Page.captureScreenshot", format="png"))["data"])


@contextlib.asynccontextmanager
async def opened(address: str, size: tuple[int, int] = (1600, 1000)) -> AsyncIterator[Tab]:
    """A page of an address, `size` pixels wide and high.

    Raises:
        RuntimeError: there is no Chromium, or it does not start.
    """
    from tornado.httpclient import AsyncHTTPClient
    from tornado.websocket import websocket_connect

    if (program := found()) is None:
        raise RuntimeError(f"none of {', '.join(NAMES)} is installed")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        given = [*OPTIONS, "--remote-debugging-port=0", f"--user-data-dir={profile}"]
        given += [f"--window-size={size[0]},{size[1]}", address]
        process = subprocess.Popen([program, *given], stderr=subprocess.PIPE, stdout=subprocess.DEVNULL)
        try:
            host = await asyncio.wait_for(asyncio.to_thread(_listening, process), WAIT)
            pages = json.loads((await AsyncHTTPClient().fetch(f"http://{host}/json")).body)
            place = next(page["webSocketDebuggerUrl"] for page in pages if page["type"] == "page")
            socket = await websocket_connect(place, max_message_size=1 << 26)
            yield Tab(socket)
            socket.close()
        finally:
            process.terminate()
            process.communicate()


def _listening(process: subprocess.Popen[bytes]) -> str:
    assert process.stderr is not None
    while line := os.read(process.stderr.fileno(), 4096):
        if match := re.search(rb"ws://([^/]+)/", line):
            return match[1].decode()
    raise RuntimeError("Chromium did not start")


def visit(address: str, what: Callable[[Tab], Awaitable[T]], size: tuple[int, int] = (1600, 1000)) -> T:
    """Open an address, do something there, and close it."""

    async def whole() -> T:
        async with opened(address, size) as tab:
            return await what(tab)

    return asyncio.run(whole())
