# make demo   build the coarse tongue, let it say /t/, leave pictures and a movie in runs/say_t/figures
# make check  lint, types and the quick tests, for between two commits: a minute or two
# make test   lint, types, documentation, tests (part of them also on two ranks) and how much of the code they reach
# make bench  what the solver costs, in minutes, against the committed numbers; make bench-full at the chapter's size, an hour
# make docs   the documentation as a site in build/docs, which opens from disk; a link that leads nowhere is an error
# make rooms  draw into docs/architecture.md which room imports which
# They need Python >= 3.12, a C compiler and make; everything else goes into .venv/

VENV := .venv
BIN := $(VENV)/bin
PYTHON ?= $(shell for p in python3.13 python3.14 python3.12 python3 python; do \
	"$$p" -c 'import sys; sys.exit(sys.version_info < (3, 12))' >/dev/null 2>&1 && { echo "$$p"; break; }; done)
export OMP_NUM_THREADS := 1

.PHONY: demo check test bench bench-full docs lint rooms clean

demo: $(VENV)/ready
	$(BIN)/tongue build -o meshes/tongue_coarse.msh --preset coarse
	$(BIN)/tongue run demos/say_t.toml -o runs/say_t --overwrite
	$(BIN)/tongue movie runs/say_t -o runs/say_t/figures/say_t.gif --seconds 2 --fps 10
	@echo "Look at runs/say_t/figures/say_t.gif and *.png; open runs/say_t/fields.xdmf in ParaView. Play with a tongue in real time: .venv/bin/tongue live"

QUICK := activation documents engine kinematics seams timestep tissue values

check: $(VENV)/ready lint
	$(BIN)/python -m pytest -n 2 --dist worksteal -m "not slow" $(QUICK:%=tests/test_%.py)

test: $(VENV)/ready lint docs
	$(BIN)/python -m pytest -n 2 --dist worksteal --cov --cov-report=
	$(BIN)/coverage report --format=total
	$(BIN)/mpiexec -n 2 $(BIN)/python -m pytest -m parallel -p no:cacheprovider </dev/null

bench: $(VENV)/ready
	$(BIN)/python -m benchmarks

bench-full: $(VENV)/ready
	$(BIN)/python -m benchmarks --full

lint: $(VENV)/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache

docs: $(VENV)/ready
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict

rooms: $(VENV)/ready
	$(BIN)/python docs/draw_rooms.py

$(VENV)/ready: pyproject.toml constraints.txt
ifeq ($(PYTHON),)
	@echo "Python 3.12 or newer is needed and none was found on the PATH; install one, or name it: make PYTHON=/path/to/python3.13" >&2; exit 2
endif
	@"$(PYTHON)" -c 'import sys; sys.exit(sys.version_info < (3, 12))' || { \
		echo "$(PYTHON) is older than Python 3.12, which is needed; name a newer one: make PYTHON=/path/to/python3.13" >&2; exit 2; }
	"$(PYTHON)" -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[wheel,dev,rom]'
	@touch $@

clean:
	rm -rf $(VENV) runs build *.egg-info
