# Tasks of a checkout. They need Linux on x86-64, Python 3.10 to 3.13 and a C++ compiler. ROS 2 is
# installed from PyPI into .venv; a ROS installation is neither needed nor used.

# The Python of .venv. Run `make clean` before changing it.
PYTHON ?= python3
# The installer: uv if it can be had, else pip. UV=no selects pip.
UV ?= $(shell command -v uv || true)

SHELL := bash
.SHELLFLAGS := -eu -o pipefail -c
.ONESHELL:
.DEFAULT_GOAL := help
MAKEFLAGS += --no-builtin-rules --no-print-directory

BIN := .venv/bin
READY := .venv/ready

# A sourced ROS or another venv would mix its libraries with those of .venv. The wheels of ROS set
# the last variable to note that LD_LIBRARY_PATH is set.
unexport AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH LD_LIBRARY_PATH PYTHONHOME
unexport PYTHONPATH ROS_DISTRO VIRTUAL_ENV _ROS_WHEELS_BOOTSTRAP_COMPLETE
export PATH := $(CURDIR)/$(BIN):$(PATH)
# Tests and demo communicate within this machine only.
export ROS_AUTOMATIC_DISCOVERY_RANGE := LOCALHOST

.PHONY: help setup demo test coverage lint format config docs bench evaluate paper soak clean

help:
	@cat <<-'END'
	make setup            install everything into .venv
	make demo             run the node on a simulated drive and check it; results in demo/
	make demo DATA=path   the same on a bag or a cloud of yours
	make test             run lint and all tests
	make coverage         run all tests and report the coverage of the package without ros/
	make lint             check style, types and spelling
	make format           format the code
	make config           write the files in config/ that derive from the sources
	make docs             build the documentation site in build/docs
	make clean            remove everything that these targets have made
	Studies; options as in make bench ARGS='--quick':
	make bench            measure speed, latency and memory
	make evaluate         measure partitions and landmarks against truth
	make paper            draw the paper's figures and check its findings
	make soak             run the endurance and fault-injection tests, 75 minutes
	END

setup: $(READY)
	@:

# .venv cannot be moved, so READY holds the folder that it was made in.
ifneq ($(file <$(READY)),$(CURDIR))
.PHONY: $(READY)
endif

$(READY): Makefile setup.py setup.cfg pyproject.toml CMakeLists.txt package.xml \
          $(wildcard msg/*.msg config/*.* config/sros2/* launch/*)
	@stop() { echo "make setup: $$1" >&2; exit 1; }
	[ "$$(uname -sm)" = "Linux x86_64" ] || stop \
	    "ROS 2 is on PyPI for Linux on x86-64 only; elsewhere use colcon with a ROS installation"
	command -v '$(PYTHON)' >/dev/null || stop "$(PYTHON) was not found; set PYTHON, for example PYTHON=python3.12"
	'$(PYTHON)' -c 'import sys; sys.exit(not (3, 10) <= sys.version_info < (3, 14))' || stop \
	    "$(PYTHON) is $$('$(PYTHON)' -V), not 3.10 to 3.13; set for example PYTHON=python3.12"
	command -v "$${CXX:-c++}" >/dev/null || stop "no C++ compiler was found; install one, for example with apt install g++"

	uv='$(UV)'
	if [ "$$(cat $(READY) 2>/dev/null)" != '$(CURDIR)' ]; then
	    echo "Setting up .venv, which takes a minute or two ..."
	    rm -rf .venv
	    if [ -n "$$uv" ] && [ "$$uv" != no ]; then
	        "$$uv" venv -q --python '$(PYTHON)' .venv
	    else
	        '$(PYTHON)' -m venv .venv || stop "venv is missing; apt install python3-venv"
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

	# The build requirements stay in .venv for colcon, hence no build isolation. numba is installed
	# with them because it bounds the version of numpy.
	sed -n '/^requires = \[/,/^\]/s/^ *"\([^"]*\)",.*/\1/p' pyproject.toml > .venv/build.txt
	"$${install[@]}" -r .venv/build.txt numba
	"$${install[@]}" --no-build-isolation -e '.[test,docs]'
	echo '$(CURDIR)' > $(READY)

demo: setup
	@$(BIN)/ellipseg demo $(if $(DATA),--data '$(DATA)') -o demo

# numba's cache misses edits in other files, hence a fresh cache. The tests marked nojit then run a
# second time as plain Python, where an index out of bounds is an error.
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

# The same two runs under coverage.py; pyproject.toml says what is measured. Kernels count in the
# run without the JIT. Left out: programs on a full disk, which cannot write what they measured.
coverage: setup
	@cache=$$(mktemp -d)
	trap 'rm -rf "$$cache"' EXIT
	rm -f .coverage .coverage.*
	cov=(--cov --cov-append --cov-report= --cov-fail-under=0)
	full_disks='test/studies/test_endurance_faults.py::test_the_requirements_hold[full_disks]'
	NUMBA_CACHE_DIR="$$cache" $(BIN)/python -m pytest -n 2 --dist loadscope "$${cov[@]}" \
	    --deselect "$$full_disks"
	NUMBA_DISABLE_JIT=1 $(BIN)/python -m pytest -n 2 --dist loadscope "$${cov[@]}" -m nojit
	$(BIN)/coverage report --skip-covered --sort=cover

lint: setup
	@bad=
	$(BIN)/ruff check -q || bad=1
	$(BIN)/ruff format -q --check || { echo "run make format"; bad=1; } >&2
	$(BIN)/mypy --no-error-summary || bad=1
	$(BIN)/codespell || bad=1
	[ -z "$$bad" ]

format: setup
	@$(BIN)/ruff check -q --fix --select I
	$(BIN)/ruff format -q

# The reference pages are written from the sources and committed; -W makes broken links errors.
config: setup
	@$(BIN)/python config/_tools/generate.py

docs: setup
	@$(BIN)/python docs/_tools/reference.py
	$(BIN)/sphinx-build -q -W --keep-going -b html docs build/docs
	echo "wrote build/docs/index.html"

clean:
	@rm -rf .venv .hypothesis .mypy_cache .pytest_cache .ruff_cache .coverage* build demo dist *.egg-info
	rm -rf ellipseg_ros/msg ellipseg_ros/*.so
	find ellipseg_ros studies test docs -name __pycache__ -prune -exec rm -rf {} +
