# `make run` and `make test` set up everything that they need. They assume only Python 3.11 to 3.13 with venv, make and a network.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready

.PHONY: run test tests quick coverage lint lock sbom audit clean

run: $(READY)  ## plant + controller on a bus, a torque profile, a summary, a recorded run
	$(BIN)/clutch-hil up

test: lint tests  ## lint, types, and every test that this machine can run, also on a real vcan; --jobs 2 runs lint in parallel with the tests

tests: $(READY)
	$(BIN)/python -m tests --numprocesses auto --durations 20  # tests/conftest.py sets their order

quick: $(READY) lint  ## while editing: lint, and the tests that neither compute for a long time nor run in real time
	$(BIN)/python -m pytest -q --numprocesses auto -m "not slow and not real_time"

coverage: $(READY)  ## share of lines and branches that the tests of `make quick` run; code that Numba compiles is not counted
	$(BIN)/python -m pytest -q --numprocesses auto -m "not slow and not real_time" --cov --cov-report term

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

lock:  ## update requirements.lock: all packages of the set-up, with versions and the hashes of their files on PyPI
	$(PYTHON) -m venv build/lock
	build/lock/bin/python -m pip install --quiet --disable-pip-version-check uv
	build/lock/bin/python -c 'import tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["build-system"]["requires"])' | \
	build/lock/bin/uv --no-config pip compile --quiet --upgrade --universal --python-version 3.11 --generate-hashes \
		--default-index https://pypi.org/simple --custom-compile-command "make lock" \
		--extra test pyproject.toml - --output-file requirements.lock

sbom:  ## build/sbom.cdx.json: all packages of requirements.lock as CycloneDX, checked against its schema
	$(PYTHON) -m venv build/sbom
	build/sbom/bin/python -m pip install --quiet --disable-pip-version-check cyclonedx-bom
	build/sbom/bin/cyclonedx-py requirements requirements.lock --pyproject pyproject.toml --output-reproducible \
		--validate --output-format JSON --output-file build/sbom.cdx.json

audit:  ## known vulnerabilities of the packages in requirements.lock; it asks PyPI, so it is not part of `make test`
	$(PYTHON) -m venv build/audit
	build/audit/bin/python -m pip install --quiet --disable-pip-version-check pip-audit
	build/audit/bin/pip-audit --strict --require-hashes --disable-pip --requirement requirements.lock

$(READY): pyproject.toml requirements.lock
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(0 if (3, 11) <= v <= (3, 13) else f"Python {v[0]}.{v[1]} is not supported; needed is 3.11 to 3.13: make PYTHON=python3.12")'
	@echo "set-up 1 of 3: a virtual environment in $(VENV)" >&2
	$(PYTHON) -m venv $(VENV)
	@echo "set-up 2 of 3: packages from the network; pip lists each" >&2
	$(BIN)/python -m pip install --progress-bar off --disable-pip-version-check --no-compile --no-deps --require-hashes --requirement requirements.lock  # the lock file has all of them, so pip resolves nothing
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --no-deps --no-build-isolation --config-settings editable_mode=compat --editable .  # compat: lets mypy and editors find the types
	@echo "set-up 3 of 3: byte code of the packages, once" >&2
	-$(BIN)/python -m compileall -q -j 0 -x '/(tests|pip|setuptools|mypy|mypyc|fontTools|lexers)/' $(VENV)/lib >/dev/null  # only packages that the bench loads; pip would use one CPU; a file for another Python version is not an error
	touch $(READY)

clean:
	rm -rf $(VENV) build *.egg-info runs .coverage .pytest_cache .mypy_cache .ruff_cache
