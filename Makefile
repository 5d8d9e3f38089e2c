PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
TOPOLOGY ?= topologies/ding2021/case_b.yaml

export OPENBLAS_NUM_THREADS := 1

.PHONY: run test test-slow lint bench clean

run: $(READY)  ## launch the 20-node network as real processes, attack it, log it, score it
	$(BIN)/gauntlet run $(TOPOLOGY)

test: $(READY)  ## the whole fast suite
	$(BIN)/python -m pytest -m "not slow" -n 2 --dist loadfile

test-slow: $(READY)  ## the long Monte Carlo checks
	$(BIN)/python -m pytest -m slow -n 2 --dist loadfile --timeout 3600

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/python -m pytest tests/test_layering.py

bench: $(READY)
	$(BIN)/python -m pip install --quiet -e '.[bench]' -c constraints.txt
	$(BIN)/python -m benchmarks

reproduce-%: $(READY)  ## a paper's campaigns, figures and tables, as topologies/PAPER/reproduce.toml lists them
	$(BIN)/gauntlet reproduce topologies/$*

$(READY): pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit("Gauntlet needs Python 3.11 or newer, this is " + sys.version.split()[0] if sys.version_info < (3, 11) else 0)'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev]' -c constraints.txt
	touch $(READY)

clean:
	rm -rf $(VENV) runs .pytest_cache .mypy_cache .ruff_cache .hypothesis build *.egg-info
