"""What a record holds is shown in the page as text: none of it runs."""

from __future__ import annotations

import asyncio
import json
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.browser.conftest import LAPTOP, PATIENCE_MS, playwright_api
from tests.gcs.replay_rig import record_flight

pytestmark = pytest.mark.asyncio(loop_scope="session")

MARKUP = "<img src=x onerror='window.owned = 1'><script>window.owned = 1</script>\"'&\x1b[2J"


def _with_markup(value: Any) -> Any:
    """The same, with markup in all texts that say something."""
    if isinstance(value, dict):
        said = ("text", "answer", "order", "reasons", "problem", "limited_by")
        return {key: _markup_of(each) if key in said else _with_markup(each) for key, each in value.items()}
    return value


def _markup_of(value: Any) -> Any:
    """Of a plain text, or of each; a cause is one of a list and stays."""
    return MARKUP if isinstance(value, str) else value


@pytest.fixture(scope="module")
def hostile(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = record_flight(tmp_path_factory.mktemp("hostile"))
    log = folder / "messages.jsonl"
    rows = [json.loads(line) for line in log.read_bytes().splitlines()]
    for row in rows:
        row["data"] = {"reasons": [MARKUP]} if row["type"] == "Refusals" else _with_markup(row["data"])
    log.write_text("".join(json.dumps(row) + "\n" for row in rows))
    return folder


async def test_nothing_of_a_record_runs_in_the_page(browser: Any, hostile: Path) -> None:
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "gcs.cli", "replay", str(hostile), "--port", "0", "--speed", "10",
        stdout=asyncio.subprocess.PIPE,
    )  # fmt: skip
    assert process.stdout is not None
    url = (await process.stdout.readline()).decode().removeprefix("page: ").strip()
    context = await browser.new_context(viewport=LAPTOP)
    try:
        page = await context.new_page()
        errors: list[str] = []
        page.on("pageerror", lambda error: errors.append(str(error)))
        await page.goto(url)
        await page.wait_for_selector("#play[data-playing]")
        shown = playwright_api.expect(page.locator("body"))
        await shown.to_contain_text("onerror", timeout=PATIENCE_MS)
        await page.locator("#play").click()
        assert await page.evaluate("document.querySelectorAll('img[src=x], body script:not([src])').length") == 0
        assert await page.evaluate("window.owned") is None
        assert not errors
    finally:
        await context.close()
        process.terminate()
        await process.wait()
