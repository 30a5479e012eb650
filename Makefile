# Everything starts from `make setup`, which runs by itself where it is needed.
# uv may live in .uv/bin, where scripts/bootstrap.sh puts it when the machine has none.
export PATH := $(CURDIR)/.uv/bin:$(PATH)
RUN := uv run --no-sync
LEROBOT := packages/lerobot_env_dexgarmentlab
SOURCES := src packages benchmarks tests scripts conftest.py

.PHONY: help setup demo test test-slow test-all test-lerobot test-package check format lint type imports spell site bench build pin clean

help: ## Show the targets
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | awk -F ':.*## ' '{printf "  %-14s %s\n", $$1, $$2}'

setup: ## Install everything that is missing; a second run takes seconds
	@./scripts/bootstrap.sh

demo: setup ## Collect one Fold Tops demonstration with its video and report
	$(RUN) dgl demo

# What tests compute is small: threads that wait for each other take longer than one. Tests start in the order of
# the files, a share for each process; who has done its own takes over half of another's.
PYTEST := OMP_NUM_THREADS=1 $(RUN) pytest --numprocesses logical --maxprocesses 4 --dist worksteal

test: setup ## Run the tests that need no GPU
	$(PYTEST) -m "not slow"

test-slow: setup ## Run the proofs that take long
	$(PYTEST) -m slow

test-all: test test-slow ## Run all tests, those that take long after the others

test-lerobot: setup ## Test what is for LeRobot, in an environment of its own
	UV_PROJECT_ENVIRONMENT=$(CURDIR)/.venvs/lerobot uv sync --quiet --project $(LEROBOT) --python 3.11 --group test
	cd $(LEROBOT) && OMP_NUM_THREADS=1 $(CURDIR)/.venvs/lerobot/bin/python -m pytest

test-package: setup ## Test one package alone, in an environment of its own: make test-package P=dgl-gam
	@test -n "$(P)" || { echo "say which package: make test-package P=dgl-gam" >&2; exit 2; }
	./scripts/test_package.sh "$(P)"

check: setup lint type imports spell ## Run all static checks

format: setup ## Format the code
	$(RUN) ruff check --fix $(SOURCES)
	$(RUN) ruff format $(SOURCES)

lint:
	$(RUN) ruff check $(SOURCES)
	$(RUN) ruff format --check $(SOURCES)
	$(RUN) python scripts/check_text.py

type:
	$(RUN) pyright

imports:
	$(RUN) lint-imports

spell:
	$(RUN) typos

site: setup ## Build the site into out/site/html; a warning is an error
	$(RUN) python scripts/build_site.py

bench: setup ## Measure the physics
	$(RUN) dgl bench physics

build: setup ## Build the wheels of all packages into dist/
	uv build --all-packages --wheel --out-dir dist
	uv build --wheel --out-dir dist $(LEROBOT)

pin: setup ## Resolve anew and write the exact versions into pyproject.toml
	$(RUN) python scripts/pin.py --upgrade

clean: ## Remove what was built, but not the environment
	rm -rf dist build .venvs .pytest_cache .ruff_cache .import_linter_cache
