# Every target makes its own .venv from pyproject.toml and constraints.txt.
PYTHON ?= python3
BIN := .venv/bin
# Matrices are small: further threads of numpy only wait busily, on two cores six times as long.
export OPENBLAS_NUM_THREADS ?= 1
# Bytecode is kept, whatever the environment says: the tests start hundreds of processes, which would compile all of it.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo fmus ssp test test-slow studies check fuzz mutations builds bench house witness sizing flown papers site release clean

demo: ssp ## build everything, run and pack one scenario, say what it came to beside the paper's value
	@rm -rf runs/demo
	@$(BIN)/desat run uosat12/table3-ocdc-ilqr-1 --out runs/demo >/dev/null
	$(BIN)/desat pack uosat12/table3-ocdc-ilqr-1
	@$(BIN)/python -m benchmarks.demo runs/demo

PLATFORMS ?=
fmus: .venv/.installed ## build the FMUs of all blocks into fmus/dist/; PLATFORMS=all: native ones for all platforms (pip install ziglang)
	$(BIN)/python -m desat.fmus.build $(if $(PLATFORMS),--platforms $(PLATFORMS))
	@$(BIN)/python -m desat.web.module

ssp: fmus ## write the SSD of every craft; .ssp files are packed on demand: desat pack [NAME]
	@$(BIN)/desat pack --ssd | grep -v ": current" || true

TESTS ?= not slow and not study
test: .venv/.installed ## lint, types and all tests but those of test-slow and studies
	@$(BIN)/python -m compileall -q orchestrator components fmus
	@$(MAKE) --no-print-directory -j2 check fmus
	$(BIN)/python -m pytest -n 2 --dist worksteal -m "$(TESTS)"

test-slow: fmus ## the tests that take long
	$(BIN)/python -m pytest -n 2 --dist worksteal -m "slow and not study"

studies: fmus ## tests that fly for weeks, walk through long pages or build the site: before a release, and where a change is of them
	$(BIN)/python -m pytest -n 2 --dist worksteal -m study

check: .venv/.installed ## lint, types, and blocks within what translates to C
	@rm -rf .venv/names && mkdir -p .venv/names/desat
	@ln -s $(CURDIR)/orchestrator/* $(CURDIR)/components $(CURDIR)/fmus .venv/names/desat
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/python -m desat.fmus.subset

HOURS ?= 1
fuzz: fmus ## mutated files through all readers, changed command lines, for HOURS; what fails is kept in tests/fuzz/corpus
	$(BIN)/python tests/fuzz --seed $$(date +%s) --hours $(HOURS)

MINUTES ?= 30
mutations: fmus ## mutated lines of what landed since the last release against the quick tests, MINUTES for components and for orchestrator; prints what lives
	$(BIN)/python -m pip install -q --disable-pip-version-check -c constraints.txt cosmic-ray coverage
	@for part in components orchestrator; do \
		$(BIN)/python tests/mutations.py $$part $$((60 * $(MINUTES))) build/mutations/$$part --landed --anew || exit 1; \
	done

builds: fmus ## native FMUs by a second compiler (package ziglang, or CC), under sanitizers, for Windows: same bits?
	$(BIN)/python tests/builds.py zig
	$(BIN)/python tests/builds.py sanitizers
	$(BIN)/python tests/builds.py windows

bench: ssp .venv-basilisk/.tried ## microseconds per step of ours and of others, into benchmarks/latest.json
	$(BIN)/python -m benchmarks.run

house: fmus ## the way of a target to its run, size, names and the commands' CPU, beside their aims
	$(BIN)/python -m benchmarks.house

witness: fmus .venv-basilisk/.tried ## the closed loop in Basilisk beside ours, against what is stored; WRITE=--write stores it anew
	$(BIN)/python -m benchmarks.witness $(WRITE)

sizing: fmus ## what `desat size` says beside closed loops, papers and others, into docs/sizing*.md, your-craft.md, questions.md
	$(BIN)/python -m benchmarks.sizing
	$(BIN)/python -m benchmarks.dumps
	$(BIN)/python -m benchmarks.your_craft
	$(BIN)/python -m benchmarks.questions

flown: fmus ## what desat says of spacecraft that flew, beside what was published, into docs/flown.md
	$(BIN)/python -m benchmarks.flown

papers: ssp ## the pages under docs/papers, from their templates and runs made now
	$(BIN)/desat help keys --markdown > docs/language.md
	$(BIN)/python -m benchmarks.pages

site: fmus ## the documentation as a site, into build/site/index.html; a warning is an error
	@rm -rf build/live && mkdir -p build/live/page
	@cd build/live && $(CURDIR)/$(BIN)/desat new craft 12u --size 12U --altitude 400km --inclination 51.6deg \
		--rods 0.2 >/dev/null && $(CURDIR)/$(BIN)/desat export web 12u --law ccpl --law predictive \
		--out page/12u.html >/dev/null
	$(BIN)/python -m sphinx -q -W --keep-going -n -b html -d build/site-doctrees docs build/site

release: site ## wheel, sdist, FMUs of all platforms, site, bill of materials, checksums into build/release/
	$(BIN)/python -m pip install -q --disable-pip-version-check -c constraints.txt -e ".[release]"
	$(BIN)/python -m benchmarks.release

.venv-basilisk/.tried:
	$(PYTHON) -m venv .venv-basilisk
	.venv-basilisk/bin/python -m pip install -q --disable-pip-version-check bsk==2.12.1 \
		|| { echo "without Basilisk: its rows stay empty"; rm -rf .venv-basilisk/bin; }
	@touch $@

clean: ## remove what the other targets have made
	rm -rf .venv .venv-basilisk fmus/dist ssp/dist runs build docs/generated *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

.venv/.installed: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "Python 3.11 or newer is needed: make PYTHON=python3.11 ...")'
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install -q --disable-pip-version-check -c constraints.txt -e ".[dev,witness]" \
		|| { echo "without libcosim, Ecos and opensvf: their tests will be skipped"; \
		$(BIN)/python -m pip install -q --disable-pip-version-check -c constraints.txt -e ".[dev]"; }
	@$(BIN)/python -m compileall -q orchestrator components fmus  # pip leaves that of a checkout out
	@touch $@
