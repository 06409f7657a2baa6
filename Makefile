# Everything happens in .venv; no target needs more than Python 3.11 and pip.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
OUT ?= out/demo

.PHONY: help setup demo test test-browser pictures check bench coverage mutate gate-million fuzz lock wheel-test faults soak scenarios scenarios-all golden-update prove clean

help:
	@echo "make demo    fly a closed loop against the mocked vehicle; video, plot and table in $(OUT)"
	@echo "make test    run the tests"
	@echo "make test-browser   the operator's page in a real Chromium"
	@echo "make pictures   the pictures of docs/, of a flight in Chromium (also needs tmux)"
	@echo "make check   ruff, mypy, import-linter, codespell"
	@echo "make bench   speed, latency and memory, beside other trackers in one run; table and plot in out/bench (6 minutes)"
	@echo "make mutate  break the safety code one operator at a time: does a test notice each? (ONLY='control.gate.*')"
	@echo "make gate-million   a million random calls of the gate and 20,000 of hypothesis'"
	@echo "make fuzz    a million damaged packets, ten thousand videos, flights, configurations, weights, requests (10 to 20 minutes)"
	@echo "make faults  break everything that can break in flight; table in out/faults (about half an hour)"
	@echo "make soak    an hour of flight on a fake clock: does memory grow, is a tick late?"
	@echo "make scenarios   closed-loop flights in simulated time, compared with the committed figures (a minute)"
	@echo "make scenarios-all   all of them, and flights drawn by lot; table and pictures in out/scenarios"
	@echo "make golden-update   accept what the golden flights of tests/replay come out as now"
	@echo "make prove   20 demo flights, each recorded and flown again to the last bit (a quarter of an hour)"
	@echo "make wheel-test   build the wheel, install it in an empty environment elsewhere, fly the demo there"

setup: $(STAMP)

$(STAMP): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --disable-pip-version-check -q -c constraints.txt -e '.[dev]'
	@touch $@

demo: $(STAMP)
	$(BIN)/gcs demo --out $(OUT)

# On two processes what can be, then what flies whole stations in real time.
test: $(STAMP)
	$(BIN)/pytest -n 2 --dist loadfile -m 'not alone'
	$(BIN)/pytest -m alone

# Needs an installed Chromium (Debian: apt install chromium), or CHROMIUM=/path/to/it.
test-browser: $(STAMP)
	$(BIN)/pytest tests/browser -o addopts='-q --strict-markers --strict-config' $(ARGS)

check: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/codespell

pictures: $(STAMP)
	$(BIN)/python -m tests.browser.pictures docs

bench: $(STAMP)
	$(BIN)/gcs bench $(ARGS)
	$(BIN)/python -m tests.page_load

coverage: $(STAMP)
	$(BIN)/coverage run --branch --include='control/gate*.py,control/fence.py,control/checks.py,control/engagement.py,control/causes.py,control/preflight.py,control/camera_check.py,control/setpoint_echo.py,control/overrun.py' -m pytest tests/control tests/property
	$(BIN)/coverage report --fail-under=100

mutate: $(STAMP)
	$(BIN)/python tests/mutation/mutate.py $(ONLY)

gate-million: $(STAMP)
	GATE_CALLS=1000000 GATE_EXAMPLES=20000 $(BIN)/pytest tests/property/test_gate_property.py --timeout 3600 --durations=5

fuzz: $(STAMP)
	$(BIN)/python -m tests.fuzz

# Pins every package to what is installed now; the next set-up elsewhere is identical.
lock: $(STAMP)
	$(BIN)/pip freeze --exclude-editable | sed 's/+cpu$$//' | grep -v '^climrt-gcs' > constraints.txt

wheel-test: $(STAMP)
	rm -rf dist build/wheel-test && $(BIN)/python -m build --wheel --outdir dist
	$(PYTHON) -m venv build/wheel-test
	build/wheel-test/bin/pip install --disable-pip-version-check -q -c constraints.txt dist/*.whl
	cd / && $(CURDIR)/build/wheel-test/bin/gcs demo --seconds 20 --out $(CURDIR)/build/wheel-test/demo

# Every fault of docs/safety.md in five phases of a flight with twenty seeds, and all pairs, on a fake clock;
# then those of a process, done to real ones in real time.
faults: $(STAMP)
	OMP_NUM_THREADS=1 $(BIN)/python -m tests.faults $(ARGS)
	$(BIN)/python -m tests.processes

soak: $(STAMP)
	$(BIN)/python -m tests.soak

scenarios: $(STAMP)
	$(BIN)/gcs scenarios --out out/scenarios $(ARGS)

scenarios-all: $(STAMP)
	$(BIN)/gcs scenarios --all --out out/scenarios $(ARGS)
	$(BIN)/gcs scenarios --occlusions 100 --random 1000

golden-update: $(STAMP)
	$(BIN)/python -m tests.replay.golden update

prove: $(STAMP)
	$(BIN)/python -m tests.replay.prove

clean:
	rm -rf $(VENV) build dist out
