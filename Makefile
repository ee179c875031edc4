# `make demo` and `make test` each do all set-up by themselves.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
OUT ?= out

.PHONY: demo test lint types bench docs notebooks wheel clean

# What it takes to use it, and then what it takes to work on it.
$(VENV)/usable: pyproject.toml
	@echo 'installing into $(VENV), which takes a minute or two'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --editable .
	touch $@

$(VENV)/ready: $(VENV)/usable
	@echo 'installing what the tests need, which takes some minutes more'
	$(BIN)/python -m pip install --quiet --editable '.[dev]'
	touch $@

demo: $(VENV)/usable
	$(BIN)/debrisgrasp demo --out-dir $(OUT)
	@echo "open $(OUT)/report.html; '. $(BIN)/activate' makes debrisgrasp a command"

# One process for each core; a process that computes on several would slow the others.
# Many tests start programs, which compile themselves anew where no bytecode is kept.
test: $(VENV)/ready
	PYTHONDONTWRITEBYTECODE= OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n auto --dist worksteal

lint: $(VENV)/ready
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .

types: $(VENV)/ready
	$(BIN)/mypy

bench: $(VENV)/ready
	for name in segmentation plan ik reach motion control calibration robot task campaign; do $(BIN)/python -m tests.benchmarks.$$name || exit 1; done

docs: $(VENV)/ready
	$(BIN)/python -m pip install --quiet --editable '.[docs]'
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

# Runs the notebooks and stores their outputs, which are read without running them.
notebooks: $(VENV)/ready
	$(BIN)/python -m pip install --quiet --editable '.[notebooks]'
	PYTHONWARNINGS=ignore $(BIN)/jupyter nbconvert --to notebook --execute --inplace \
	    --ExecutePreprocessor.record_timing=False docs/notebooks/*.ipynb

wheel: $(VENV)/usable
	$(BIN)/python -m pip wheel --quiet --no-deps --wheel-dir dist .

clean:
	rm -rf $(VENV) build dist $(OUT)
