# Sets up and calls; everything else lives in the packages. A sourced ROS 2 is used where there is one, .venv otherwise.
#
#   make bringup            the stack with the simulated board     FOR=5  SOURCE=sim|emulator|can  SCENE=name|file  ARGS=...
#   make test               every test                             ARGS="-k name" goes to pytest
#   make check              ruff and mypy
#   make soak               the driver under a fault every few seconds, half an hour of it     FOR=60
#   make bench              the benchmarks that take seconds: slcan readers side by side
#   make figures            the figures of docs/
#   make clean              removes what was built; make distclean the .venv as well

SHELL := /bin/bash
.SHELLFLAGS := -e -o pipefail -c
.DEFAULT_GOAL := bringup
.PHONY: bringup test check soak bench figures setup build clean distclean

IN_ENVIRONMENT := source tools/environment.sh;
SOURCES := $(shell find src launch -type f -not -name '*.pyc' -not -path '*.egg-info*')
BUILT := install/.built

ifdef ROS_DISTRO
READY := setup
setup:
	@tools/setup.sh
else
READY := .venv/.ready
setup: $(READY)
endif

.venv/.ready: tools/setup.sh tools/relocate.py tools/venv_setup.bash tools/requirements.txt
	@tools/setup.sh

build: $(BUILT)

$(BUILT): $(SOURCES) tools/build.sh | $(READY)
	@tools/build.sh

ifndef ROS_DISTRO
$(BUILT): .venv/.ready
endif

bringup: $(BUILT)
	@$(IN_ENVIRONMENT) exec posfet bringup $(if $(FOR),--for $(FOR)) $(if $(SOURCE),source:=$(SOURCE)) $(if $(SCENE),scene:=$(SCENE)) $(ARGS)

test: $(BUILT)
	@$(IN_ENVIRONMENT) exec python3 -m pytest $(ARGS)

check: $(BUILT)
	@$(IN_ENVIRONMENT) ruff check . && ruff format --check . && mypy

soak: $(BUILT)
	@$(IN_ENVIRONMENT) exec python3 -m posfet_driver.soak --for $(or $(FOR),1800) $(ARGS)

bench: $(BUILT)
	@$(IN_ENVIRONMENT) exec python3 benchmarks/slcan.py $(ARGS)

figures: $(BUILT)
	@$(IN_ENVIRONMENT) exec python3 -m posfet_model.figures $(ARGS)

clean:
	rm -rf build install log

distclean: clean
	rm -rf .venv
