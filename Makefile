# Everything a person or CI does with this repository; "make help" lists it.
#
# ROS 2 comes from the Jazzy sourced in this shell, or else as wheels in .venv. Both packages are
# built by colcon into install/, the Python one as links: an edited source takes effect at once. A new
# file in config/ or launch/, a changed message or entry point is built by the next make.

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help setup kernels field mission train policy train-fleet curves figures test test-all test-ubuntu docs fuzz chaos soak golden check format bench clean distclean

VENV := .venv
PYTHON ?=
ROS := $(if $(filter jazzy,$(ROS_DISTRO)),$(if $(findstring $(CURDIR)/$(VENV),$(AMENT_PREFIX_PATH)),wheels,sourced),wheels)
INSTALLED := $(VENV)/.installed-$(ROS)
DEVELOPED := $(VENV)/.developed-$(ROS)
LEARNS := $(VENV)/.learns-$(ROS)
CLUSTERS := $(VENV)/.clusters-$(ROS)
DOCUMENTS := $(VENV)/.documents-$(ROS)
BUILT := install/.built
UBUNTU := build/ubuntu_24_04
STEP := sh tools/step.sh

# Images often set it: then each process compiles all of its sources, half of a node's start.
unexport PYTHONDONTWRITEBYTECODE

# The ROS log needs a home.
ifeq ($(HOME),)
export ROS_LOG_DIR := $(CURDIR)/log/ros
endif

# Unless parts are named: all but what "make test-all" adds.
TESTS ?= test -m 'not nightly'
# Tests with ROS processes wait most of the time: more than there are cores. Each takes whole modules,
# in order: what a module shares is flown or learned once.
WORKERS ?= $(shell expr $$(nproc) + 2)
BENCHES ?= $(sort $(filter-out bench/learners.py,$(wildcard bench/*.py)))

# The variables of mission and train; "make help" prints these lines. Only what is set is passed on:
# the commands know their own defaults.
#:SCENARIO   name in config/scenarios, or a YAML file (paper_10x10)
#:POLICY     who decides on board: sweep, hert, a learned policy's file, or module:function (best:
#:           which of those does best in sampled missions of the scenario)
#:SEED       mission seed: data and channels (0)
#:BANDWIDTH  how a hover shares bandwidth: exact, equal or cvxpy (exact)
#:UAVS       number of UAVs (as in the scenario)
#:ARGS       any further arguments of the command, see ARGS=--help
MISSION_OPTIONS = \
  $(if $(SCENARIO),--scenario '$(SCENARIO)') \
  $(if $(POLICY),--policy '$(POLICY)') \
  $(if $(SEED),--seed '$(SEED)') \
  $(if $(BANDWIDTH),--bandwidth '$(BANDWIDTH)') \
  $(if $(UAVS),--uavs '$(UAVS)') \
  $(ARGS)

#<LIST       the loggers: CSV, TSV, xlsx, GeoJSON, KML or KMZ
#<UAVS       how many fly (2)
#<ARGS       any further arguments of the command, see ARGS=--help
FIELD_OPTIONS = \
  $(if $(LIST),'$(LIST)') \
  $(if $(UAVS),--uavs '$(UAVS)') \
  $(ARGS)

#>SCENARIO   name in config/scenarios, or a YAML file (paper_10x10)
#>ALGORITHM  aqmix, qmix, aiql, branches, imitation or module:Name (aqmix)
#>PRESET     name in config/training, or a YAML file (strong)
#>MINUTES    how long to train each seed (30)
#>SEED       of weights, exploration and missions; several as SEED='0 1 2' (0)
#>UAVS       number of UAVs (as in the scenario)
#>RESUME     run folder to go on with, instead of all these
#>ARGS       any further arguments of the command, see ARGS=--help
TRAIN_OPTIONS = \
  $(if $(SCENARIO),--scenario '$(SCENARIO)') \
  $(if $(ALGORITHM),--algorithm '$(ALGORITHM)') \
  $(if $(PRESET),--preset '$(PRESET)') \
  $(if $(MINUTES),--minutes '$(MINUTES)') \
  $(if $(SEED),--seed $(SEED)) \
  $(if $(UAVS),--uavs '$(UAVS)') \
  $(if $(RESUME),--resume '$(RESUME)') \
  $(ARGS)

#=SCENARIO   YAML file of your field
#=MINUTES    how long to learn (10)
#=UAVS       number of UAVs (as in the scenario)
#=SEED       of exploration and missions (0)
#=ARGS       any further arguments of the command, see ARGS=--help
POLICY_OPTIONS = \
  $(if $(SCENARIO),--scenario '$(SCENARIO)') \
  $(if $(MINUTES),--minutes '$(MINUTES)') \
  $(if $(UAVS),--uavs '$(UAVS)') \
  $(if $(SEED),--seed '$(SEED)') \
  $(ARGS)
RUNS ?= $(wildcard runs/train/*/)

#+SCENARIO, ALGORITHM (not qmix), PRESET, SEED (one), UAVS and ARGS as of make train, and
#+MINUTES    how long to train (60)
#+WORLDS     worlds to fly in at once, each with a fleet of its own (1)
#+OUTPUT     run folder; one that holds the same run already is gone on with
TRAIN_FLEET_OPTIONS = \
  $(if $(SCENARIO),--scenario '$(SCENARIO)') \
  $(if $(ALGORITHM),--algorithm '$(ALGORITHM)') \
  $(if $(PRESET),--preset '$(PRESET)') \
  $(if $(MINUTES),--minutes '$(MINUTES)') \
  $(if $(SEED),--seed '$(SEED)') \
  $(if $(UAVS),--uavs '$(UAVS)') \
  $(if $(WORLDS),--worlds '$(WORLDS)') \
  $(if $(OUTPUT),--output '$(OUTPUT)') \
  $(ARGS)

#-SCALE      smoke (minutes), laptop (two cores, a night), paper (a cluster), or a YAML file (laptop)
#-ONLY       studies, as ONLY='density range' (all; ARGS=--list lists them)
#-ENGINE     local or ray (local)
#-ADDRESS    of the Ray cluster (none: one is started on this machine)
#-ARGS       any further arguments of the command, see ARGS=--help
FIGURES_OPTIONS = \
  $(if $(SCALE),--scale '$(SCALE)') \
  $(if $(ONLY),--only $(ONLY)) \
  $(if $(ENGINE),--engine '$(ENGINE)') \
  $(if $(ADDRESS),--address '$(ADDRESS)') \
  $(ARGS)

help:  ## this list
	@echo 'make TARGET [VARIABLE=value ...]'
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  %-11s %s\n", $$1, $$2 }' Makefile
	@echo 'Variables of make mission, with their defaults:'
	@sed -n 's/^#:/  /p' Makefile
	@echo 'Of make field:'
	@sed -n 's/^#</  /p' Makefile
	@echo 'Of make train:'
	@sed -n 's/^#>/  /p' Makefile
	@echo 'Of make policy:'
	@sed -n 's/^#=/  /p' Makefile
	@echo 'Of make train-fleet:'
	@sed -n 's/^#+/  /p' Makefile
	@echo 'Of make curves:'
	@echo '  RUNS       run folders (all of runs/train); ARGS as --output and --reference'
	@echo 'Of make figures:'
	@sed -n 's/^#-/  /p' Makefile
	@echo 'Of the set-up:'
	@echo '  PYTHON     which Python to use (the first 3.11 or 3.12 of python3, python3.12, python3.11)'

setup: $(BUILT)  ## everything that missions need, in .venv, build and install (2 minutes once)
	@echo 'set-up: ready; "make mission" flies, docs/how_to/nodes.md shows how to reach the executables'

kernels: $(INSTALLED)  ## compile ahead what the first large job would wait for (three to four minutes of processor time, once)
	@UAV_COLLECT_KERNELS=compiled $(VENV)/bin/python -m uav_collect evaluate --missions 1 --bound \
	  --policy sweep strong anywhere lookahead:sweep > /dev/null
	@echo 'kernels: compiled'

field: $(INSTALLED)  ## make a scenario of a list of loggers, with a map, as LIST=loggers.csv UAVS=3
	@$(VENV)/bin/python -m uav_collect field $(FIELD_OPTIONS)

mission: $(BUILT)  ## fly a mission over ROS 2 and show it, as SCENARIO=lillgrund POLICY=hert SEED=7
	@. install/setup.sh && $(VENV)/bin/python -m uav_collect mission $(MISSION_OPTIONS)

train: $(INSTALLED) $(LEARNS)  ## learn a policy, as SCENARIO=paper_8x8 MINUTES=10 SEED=7
	@$(VENV)/bin/python -m uav_collect train $(TRAIN_OPTIONS)

policy: $(INSTALLED) $(LEARNS)  ## the best policy for your field, as SCENARIO=my_field.yaml MINUTES=10
	@$(VENV)/bin/python -m uav_collect refine $(POLICY_OPTIONS)

train-fleet: $(BUILT) $(LEARNS)  ## learn over ROS 2 while a fleet flies, as SCENARIO=paper_8x8 WORLDS=2
	@. install/setup.sh && $(VENV)/bin/python -m uav_collect train-fleet $(TRAIN_FLEET_OPTIONS)

curves: $(INSTALLED)  ## draw the learning curves of RUNS, into learning_curves.png
	@$(VENV)/bin/python -m uav_collect curves $(RUNS) $(ARGS)

figures: $(INSTALLED) $(LEARNS) $(if $(filter ray,$(ENGINE)),$(CLUSTERS))  ## the figures of the paper's evaluation, as SCALE=smoke
	@$(VENV)/bin/python -m uav_collect figures $(FIGURES_OPTIONS)

test: $(BUILT) $(DEVELOPED) $(LEARNS) $(CLUSTERS)  ## run the tests; TESTS=test/physics runs a part
	@. install/setup.sh && $(VENV)/bin/python -m pytest -n $(WORKERS) --dist loadfile --no-loadscope-reorder \
	  $(TESTS) $(ARGS)

# Each night: every flight in full, and twice as much nonsense.
test-all:  ## run the tests, and those that take long
	@UAV_COLLECT_FUZZ_TRIES=2000 $(MAKE) --no-print-directory test TESTS=test

test-ubuntu: $(BUILT) $(DEVELOPED) $(UBUNTU)/.built  ## fly and read settings with the packages of Ubuntu 24.04's apt
	@. install/setup.sh && . $(UBUNTU)/install/local_setup.sh && \
	  UAV_COLLECT_UBUNTU=$(CURDIR)/$(UBUNTU)/packages $(VENV)/bin/python -m pytest test/nodes/test_ubuntu.py
	@PYTHONPATH=$(UBUNTU)/packages $(VENV)/bin/python -m pytest test/scenario test/training/test_config.py

docs: $(BUILT) $(DOCUMENTS)  ## build the site of docs/ in build/site, to be read without a network
	@. install/setup.sh && export PYTHONPATH=.$${PYTHONPATH:+:$$PYTHONPATH} && \
	  $(VENV)/bin/python -m tools.pages.reference && \
	  UAV_COLLECT_KERNELS=interpreted NO_MKDOCS_2_WARNING=1 $(VENV)/bin/python -m mkdocs build -q
	@echo 'site: build/site/index.html'

fuzz: $(BUILT) $(DEVELOPED) $(LEARNS)  ## try every surface by nonsense, as MINUTES=30 SURFACES='log bag'
	@. install/setup.sh && $(VENV)/bin/python tools/fuzz.py $(if $(MINUTES),--minutes '$(MINUTES)') $(SURFACES)

chaos: $(BUILT) $(LEARNS)  ## kill, stop and starve every node of a fleet in flight, as ROUNDS=3
	@. install/setup.sh && $(VENV)/bin/python tools/endurance/chaos.py $(if $(ROUNDS),--rounds '$(ROUNDS)') $(ARGS)

soak: $(BUILT) $(LEARNS)  ## fly for long: what grows, what leaks, what is lost, as MINUTES=60
	@. install/setup.sh && $(VENV)/bin/python tools/endurance/soak.py $(if $(MINUTES),--minutes '$(MINUTES)') $(ARGS)

golden: $(INSTALLED)  ## write the digests of mission logs anew; their diff is a change of behaviour
	@PYTHONPATH=.:test/helpers $(VENV)/bin/python test/helpers/golden_logs.py

check: $(DEVELOPED) $(LEARNS)  ## ruff, mypy, bandit, the structure of the package and the licences of others, as CI does
	@$(VENV)/bin/ruff check
	@$(VENV)/bin/ruff format --check
	@$(VENV)/bin/mypy
	@$(VENV)/bin/python tools/structure.py
	@$(VENV)/bin/bandit -qr -c pyproject.toml uav_collect tools launch setup.py
	@$(VENV)/bin/python tools/licences.py

format: $(DEVELOPED)  ## let ruff mend what it can
	@$(VENV)/bin/ruff check --fix
	@$(VENV)/bin/ruff format

bench: $(BUILT) $(DEVELOPED) $(LEARNS)  ## measure, each figure beside its peer or limit; BENCHES=bench/bandwidth.py for one
	@. install/setup.sh && for bench in $(BENCHES); do $(VENV)/bin/python $$bench $(ARGS) || exit; done

clean:  ## remove what was built
	rm -rf build install log

distclean: clean  ## remove .venv and the tools' caches too
	rm -rf $(VENV) .mypy_cache .pytest_cache .ruff_cache .hypothesis

$(INSTALLED): requirements/locked/$(ROS).txt tools/make_venv.sh tools/install_locked.sh \
    tools/write_ros_prefix.sh tools/link_package.sh
	@sh tools/make_venv.sh $(VENV) $(ROS) $(PYTHON)
	@touch $@

$(DEVELOPED): $(INSTALLED) requirements/locked/dev.txt
	@$(STEP) 'installing what requirements/dev.txt and pettingzoo.txt list (10 s)' \
	  sh tools/install_locked.sh $(VENV) dev
	@touch $@

$(LEARNS): $(INSTALLED) requirements/train.txt requirements/locked/train.txt tools/install_training.sh
	@sh tools/install_training.sh $(VENV)
	@touch $@

$(CLUSTERS): $(LEARNS) requirements/locked/cluster.txt
	@$(STEP) 'installing Ray (0.1 GB to fetch)' sh tools/install_locked.sh $(VENV) cluster
	@touch $@

$(DOCUMENTS): $(INSTALLED) requirements/locked/documents.txt
	@$(STEP) 'installing what requirements/documents.txt lists (10 MB to fetch)' \
	  sh tools/install_locked.sh $(VENV) documents
	@touch $@

# Modules of messages fit the numpy that they were built with, or a newer one.
$(UBUNTU)/.built: $(BUILT) requirements/locked/ubuntu_24_04.txt
	@rm -rf $(UBUNTU)
	@$(STEP) 'installing what requirements/ubuntu_24_04.txt lists' \
	  sh tools/install_locked.sh $(VENV) ubuntu_24_04 --target $(UBUNTU)/packages
	@if [ -f $(VENV)/setup.sh ]; then . $(VENV)/setup.sh; fi; \
	  export PYTHONPATH=$(CURDIR)/$(UBUNTU)/packages$${PYTHONPATH:+:$$PYTHONPATH}; \
	  unset MFLAGS MAKELEVEL; MAKEFLAGS=-j$$(nproc) \
	  $(STEP) 'building uav_collect_msgs with these' $(VENV)/bin/colcon build \
	    --packages-select uav_collect_msgs --build-base $(UBUNTU)/build --install-base $(UBUNTU)/install
	@touch $@

# Folders stand for the files added to them. colcon runs make itself: a jobserver of ours would only
# confuse it, and its own limit on the load would leave cores idle.
$(BUILT): $(INSTALLED) package.xml setup.py setup.cfg colcon_defaults.yaml resource/uav_collect \
    tools/packages_to_build.sh \
    $(shell find msg_defs stand_ins config launch -type d -o -path 'msg_defs/*' -type f \
      -o -path 'stand_ins/*' -type f 2> /dev/null)
	@if [ -f $(VENV)/setup.sh ]; then . $(VENV)/setup.sh; fi; \
	  unset MFLAGS MAKELEVEL; MAKEFLAGS=-j$$(nproc) \
	  $(STEP) 'building the messages and uav_collect (about a minute)' \
	  $(VENV)/bin/colcon build --paths $$(sh tools/packages_to_build.sh)
	@touch $@
