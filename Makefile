# The two commands: `make compare` runs the main job, `make test` runs the tests; each sets everything up by itself.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
PEERS := $(VENV)-peers
EXPERIMENTS := $(wildcard experiments/*.toml)

.PHONY: compare test check slow benchmark random matrix reports clean help

compare: $(STAMP)  ## the Section 5 table and figures
	$(BIN)/occ run experiments/section5.toml

test: $(STAMP)  ## the default tests
	$(BIN)/pytest -n 2

slow: $(STAMP)  ## the long tests, and each benchmark once
	$(BIN)/pytest -n 2 -m "slow or benchmark"

check: $(STAMP)  ## formatting, lint and types
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy

benchmark: $(STAMP) $(PEERS)/.installed  ## timings, and reports/benchmarks.md beside other packages
	$(BIN)/pytest tests/benchmarks -m benchmark --benchmark-enable --benchmark-only
	$(BIN)/python -m tests.benchmarks.side_by_side $(PEERS)/bin/python reports

random: $(STAMP)  ## random tasks and wrenches, each solved in several ways, reports/random_*.md (over an hour; resumes)
	$(BIN)/python -m tests.benchmarks.random_allocation reports
	$(BIN)/python -m tests.benchmarks.random_work reports
	$(BIN)/python -m tests.benchmarks.random_squares reports

matrix: $(STAMP)  ## every motion with every objective and keep, reports/motions.md (minutes; resumes)
	$(BIN)/python -m tests.benchmarks.motions reports

reports: $(STAMP)  ## every shipped experiment
	@for file in $(EXPERIMENTS); do echo "== $$file"; \
	case $$file in experiments/atlas_*) command=atlas ;; *) command=run ;; esac; \
	$(BIN)/occ $$command $$file || [ $$? -eq 1 ] || exit 1; done

clean:  ## remove the environment and caches
	rm -rf $(VENV) $(PEERS) build *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis

help:
	@grep -E '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*## /\t/'

$(STAMP): pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit("occ needs Python 3.11 or newer, not " + sys.version.split()[0] if sys.version_info < (3, 11) else 0)'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	@touch $(STAMP)

# Other packages, for the benchmark only: one of them cannot live beside occ's CasADi.
$(PEERS)/.installed: tests/benchmarks/peers/requirements.txt
	$(PYTHON) -m venv $(PEERS)
	$(PEERS)/bin/python -m pip install --quiet --disable-pip-version-check -r tests/benchmarks/peers/requirements.txt
	@touch $@
