# Every target sets up what it needs. README.md shows the plain commands.
PYTHON ?= python3
BIN := .venv/bin
RUN := $(BIN)/sprain-cosim
OUT ?= out
ON_ALL_CORES := -n auto --dist worksteal
# reference numbers, not part of the project: tests and checks that need them skip and say so where the folder is absent
export SPRAIN_REFERENCE ?= $(abspath ../shared/reference)

.PHONY: bench browser demo docs test validate lint build wheel wine windows lock clean

demo: .venv/installed
	$(RUN) build --quick
	$(RUN) run incline30 --out $(OUT)/incline30 --force
	@echo
	$(RUN) run incline30_brace --out $(OUT)/incline30_brace --force
	@echo
	$(RUN) plot $(OUT)/incline30 $(OUT)/incline30_brace --out $(OUT)

test: build lint
	$(RUN) doctor
	$(BIN)/python -m pytest $(ON_ALL_CORES)

validate: build
	$(BIN)/python -m pytest $(ON_ALL_CORES) -m "long or not long"
	$(RUN) validate --out $(OUT)/validation

docs: build
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict   # not --quiet: mkdocs then counts no warning
	@echo "written: build/site/index.html"

bench: build
	$(BIN)/python tools/bench_versions.py
	$(BIN)/python tools/bench.py

# needs root on Debian when there is no Chromium yet
browser: build
	command -v chromium >/dev/null || command -v google-chrome >/dev/null || { apt-get update -qq && apt-get install -y -qq chromium; }
	SPRAIN_BROWSER=required $(BIN)/python -m pytest tests/cli/test_browser.py

# one wheel with the FMUs for linux64, win64 and darwin64: needs mingw-w64 (Debian: gcc-mingw-w64-x86-64); zig, 440 MB, links for macOS
wheel: .venv/installed
	$(BIN)/python -m pip install --quiet ziglang==0.17.1
	$(RUN) build --platform linux64 --platform win64 --platform darwin64
	$(BIN)/python -m pip wheel --quiet --no-deps --no-build-isolation --wheel-dir dist .
	@ls -l dist/*.whl

# the FMUs for Windows, run under wine; needs root on Debian when wine or mingw-w64 is not there yet
wine: .venv/installed
	command -v wine >/dev/null && command -v x86_64-w64-mingw32-gcc >/dev/null || \
	  { apt-get update -qq && apt-get install -y -qq --no-install-recommends wine wine64 gcc-mingw-w64-x86-64; }
	$(RUN) build
	SPRAIN_WINE=required $(BIN)/python -m pytest -m long tests/fmi/test_windows.py

# the whole package in a Windows Python under wine 10; Debian, root, 2.5 GB and the network at the first time
WINDOWS ?= build/windows
windows: .venv/installed
	@if [ ! -f /etc/debian_version ] || [ "$$(id -u)" != 0 ]; then echo "make windows: needs Debian and root; nothing run"; else \
	  $(RUN) build --platform linux64 --platform win64 && $(BIN)/python tools/windows.py set-up $(WINDOWS) && \
	  SPRAIN_WINDOWS=$(abspath $(WINDOWS)) $(BIN)/python -m pytest -m long tests/robust/test_under_wine.py; fi

lint: .venv/installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

build: .venv/installed
	$(RUN) build

.venv/installed: requirements.txt pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "error: Python 3.11 or newer is needed; set PYTHON=...")'
	$(PYTHON) -m venv .venv || { $(PYTHON) -m pip install --user virtualenv && $(PYTHON) -m virtualenv .venv; }
	$(BIN)/python -m pip install --quiet --require-hashes -r requirements.txt
	$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation -e .
	$(BIN)/python -m compileall -q sprain_cosim   # as pip does for a wheel: the first run is as fast as any other
	touch $@

# needs uv; writes the versions and hashes of everything that `make` installs
lock:
	uv pip compile --quiet --universal --python-version 3.11 --extra dev --extra distributed --extra parquet --extra docs --extra xarray --generate-hashes \
	  --no-emit-index-url --no-emit-find-links --no-header --no-annotate pyproject.toml -o requirements.txt

clean:
	rm -rf .venv build dist $(OUT) sprain_cosim/_fmus .pytest_cache .mypy_cache .ruff_cache .hypothesis
