# Everything that is run from a checkout. It needs Linux on x86-64, Python 3.10 to 3.13 and a C++
# compiler; ROS 2 comes from PyPI, into .venv. A ROS installation is neither needed nor used.

# The Python of .venv; `make clean` before another one.
PYTHON ?= python3
# The installer: uv where it is present or installable, else pip; UV=no for pip in any case.
UV ?= $(shell command -v uv || true)

SHELL := bash
.SHELLFLAGS := -eu -o pipefail -c
.ONESHELL:
.DEFAULT_GOAL := help
MAKEFLAGS += --no-builtin-rules --no-print-directory

BIN := .venv/bin
READY := .venv/ready

# A sourced ROS or another venv would mix its libraries with those of .venv. The last one is the
# mark by which the wheels of ROS know that LD_LIBRARY_PATH is set.
unexport AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH LD_LIBRARY_PATH PYTHONHOME
unexport PYTHONPATH ROS_DISTRO VIRTUAL_ENV _ROS_WHEELS_BOOTSTRAP_COMPLETE
export PATH := $(CURDIR)/$(BIN):$(PATH)
# Tests and demo talk to processes of this machine only.
export ROS_AUTOMATIC_DISCOVERY_RANGE := LOCALHOST

.PHONY: help setup demo test bench evaluate paper soak lint format clean

help:
	@cat <<-'END'
	make setup            installs everything into .venv
	make demo             runs the main job on a simulated scene, results in demo/
	make demo DATA=path   the same on a bag or a cloud of yours
	make test             runs lint and all tests
	make bench            measures speed, latency and memory
	make evaluate         measures partitions and landmarks against truth
	make paper            draws the paper's figures and checks its findings
	make soak             runs the endurance and fault-injection tests, 75 minutes
	                      with options: make bench ARGS='--quick'
	make lint             checks style and types
	make format           formats the code
	make clean            removes what the others have made
	END

setup: $(READY)
	@:

# .venv can't be moved, so it notes where it belongs.
ifneq ($(file <$(READY)),$(CURDIR))
.PHONY: $(READY)
endif

$(READY): Makefile setup.py setup.cfg pyproject.toml CMakeLists.txt package.xml \
          $(wildcard msg/*.msg config/*.* config/sros2/* launch/*)
	@stop() { echo "make setup: $$1" >&2; exit 1; }
	[ "$$(uname -sm)" = "Linux x86_64" ] || stop \
	    "ROS 2 is on PyPI for Linux on x86-64 only; elsewhere use colcon with a ROS installation"
	command -v '$(PYTHON)' >/dev/null || stop "there is no $(PYTHON); set PYTHON=python3.12, say"
	'$(PYTHON)' -c 'import sys; sys.exit(not (3, 10) <= sys.version_info < (3, 14))' || stop \
	    "$(PYTHON) is $$('$(PYTHON)' -V), not 3.10 to 3.13; set PYTHON=python3.12, say"
	command -v "$${CXX:-c++}" >/dev/null || stop "there is no C++ compiler; apt install g++, say"

	uv='$(UV)'
	if [ "$$(cat $(READY) 2>/dev/null)" != '$(CURDIR)' ]; then
	    echo "Setting up .venv, which takes a minute or two ..."
	    rm -rf .venv
	    if [ -n "$$uv" ] && [ "$$uv" != no ]; then
	        "$$uv" venv -q --python '$(PYTHON)' .venv
	    else
	        '$(PYTHON)' -m venv .venv || stop "no venv; apt install python3-venv, say"
	    fi
	else
	    echo "Updating .venv ..."
	fi
	if [ -z "$$uv" ]; then
	    [ -x $(BIN)/uv ] || $(BIN)/python -m pip install -qq uv || true
	    if [ -x $(BIN)/uv ]; then uv=$(BIN)/uv; fi
	fi
	if [ -n "$$uv" ] && [ "$$uv" != no ]; then
	    install=("$$uv" pip install -q --python $(BIN)/python)
	else
	    install=($(BIN)/python -m pip install -q --disable-pip-version-check)
	fi

	# The build requirements stay in .venv, for colcon: hence no build isolation. numba comes
	# with them, since it bounds the version of numpy.
	sed -n '/^requires = \[/,/^\]/s/^ *"\([^"]*\)",.*/\1/p' pyproject.toml > .venv/build.txt
	"$${install[@]}" -r .venv/build.txt numba
	"$${install[@]}" --no-build-isolation -e '.[test]'
	echo '$(CURDIR)' > $(READY)

demo: setup
	@$(BIN)/ellipseg demo $(if $(DATA),--data '$(DATA)') -o demo

# numba's cache doesn't notice an edit in another file, hence a new one; then the tests marked
# nojit run as plain Python, where an index out of bounds is an error.
test: setup lint
	@cache=$$(mktemp -d)
	trap 'rm -rf "$$cache"' EXIT
	NUMBA_CACHE_DIR="$$cache" $(BIN)/python -m pytest -n 2 --dist loadscope
	NUMBA_DISABLE_JIT=1 $(BIN)/python -m pytest -n 2 --dist loadscope -m nojit

# Studies; `python -m studies` lists them. Without ARGS all of it is measured and written.
bench: setup
	@$(BIN)/python -m studies.benchmark $(or $(ARGS),-o docs/results)

evaluate: setup
	@$(BIN)/python -m studies.partition $(or $(ARGS),-o results)
	[ -n '$(ARGS)' ] || $(BIN)/python -m studies.landmarks -o results

paper: setup
	@$(BIN)/python -m studies.paper $(or $(ARGS),-o paper)

soak: setup
	@$(BIN)/python -m studies.endurance $(or $(ARGS),-o docs/results)

lint: setup
	@bad=
	$(BIN)/ruff check -q || bad=1
	$(BIN)/ruff format -q --check || { echo "make format mends that"; bad=1; } >&2
	$(BIN)/mypy --no-error-summary || bad=1
	[ -z "$$bad" ]

format: setup
	@$(BIN)/ruff check -q --fix --select I
	$(BIN)/ruff format -q

clean:
	@rm -rf .venv .hypothesis .mypy_cache .pytest_cache .ruff_cache build demo dist *.egg-info
	rm -rf ellipseg_ros/msg ellipseg_ros/*.so
	find ellipseg_ros test -name __pycache__ -prune -exec rm -rf {} +
