"""`python -m tests.conformance udpin://0.0.0.0:14550`: what a camera answers, as a table; exit status 1 if it fails.

udpin waits for a camera that speaks first, udpout speaks to one. The camera must show a picture and follow nothing.
"""

from __future__ import annotations

import argparse
import asyncio
import sys
import time

from tests.conformance.checks import CHECKS, SLOW_CHECKS, Check, NotApplicableError
from tests.conformance.client import Client

_CHECK_S = 30.0


async def _outcome(check: Check, client: Client) -> tuple[str, str]:
    try:
        async with asyncio.timeout(_CHECK_S):
            await check(client)
    except NotApplicableError as error:
        return "n/a", str(error)
    except TimeoutError:
        return "FAIL", f"not done within {_CHECK_S:g} s"
    except AssertionError as error:
        return "FAIL", str(error).splitlines()[0] if str(error) else "not so"
    return "PASS", ""


async def _run(url: str, wait_s: float, quick: bool) -> int:
    client = await Client.open(url)
    try:
        system, component = await client.find_camera(wait_s)
    except AssertionError:
        print(f"no camera's heartbeat at {url} within {wait_s:g} s", file=sys.stderr)
        return 1
    print(f"camera: system {system}, component {component}")
    alive = asyncio.create_task(client.keep_alive())
    failed = 0
    for check in (*CHECKS, *(() if quick else SLOW_CHECKS)):
        begun_s = time.monotonic()
        outcome, why = await _outcome(check, client)
        failed += outcome == "FAIL"
        said = (check.__doc__ or check.__name__).splitlines()[0]
        print(f"{outcome:4} {time.monotonic() - begun_s:5.1f} s  {said}{f'  [{why}]' if why else ''}", flush=True)
    alive.cancel()
    client.close()
    print(f"{failed} failed" if failed else "all passed")
    return 1 if failed else 0


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.conformance", description=__doc__)
    parser.add_argument("url", help="udpin://HOST:PORT or udpout://HOST:PORT")
    parser.add_argument("--wait", type=float, default=15.0, metavar="S", help="for its first heartbeat")
    parser.add_argument("--quick", action="store_true", help="without the checks that take seconds")
    args = parser.parse_args()
    return asyncio.run(_run(args.url, args.wait, args.quick))


if __name__ == "__main__":
    sys.exit(main())
