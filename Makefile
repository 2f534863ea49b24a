# Set-up, build, and shortcuts to the commands of the packages. Uses a sourced ROS 2 if there is one, .venv otherwise.
#
#   make bringup            run the stack with the simulated board     WEB=1  FOR=5  SOURCE=sim|emulator|can  SCENE=name|file  ARGS=...
#   make test               run all tests but the slow ones (in real time, or long)      ARGS="-k name" goes to pytest
#   make test-cortex-m      run the reference firmware's image on an emulated Cortex-M3, driver and model on it; part of test-vm
#   make test-vm            run the driver on SocketCAN in a virtual machine with Debian's kernel     ARGS="-k netem"
#   make check              run ruff, mypy, numpydoc, import-linter, clang-format and clang-tidy
#   make sanitize           test and fuzz the compiled path with a build that stops at undefined behaviour and at wrong accesses to memory    FOR=600
#   make soak               run the slow tests, the adversary, then the driver under faults for half an hour     FOR=60  SCANS=100000
#   make bench              measure speed; writes benchmarks/RESULTS.md    FULL=1  ONLY=latency (prints only)
#   make fronts             measure run time against error of every stage and of the pipeline beside peers; writes docs/runtime_accuracy.md
#   make stability          run every follower model for 1e8 steps, half an hour     STEPS=1e6
#   make accuracy           measure the accuracy of forces and contacts; writes docs/accuracy.md    FULL=1  ONLY=effects (that section)
#   make figures            draw the figures of docs/
#   make screenshots        take the pictures of the browser view in docs/ with Chromium
#   make wheel              build the Python package without ROS into dist/
#   make parameters         write the tables of docs/parameters.md
#   make reference          write docs/messages.md, services.md and commands.md
#   make docs               build the documentation site in build/docs; fails for a link without a target
#   make protocol           write the tables of docs/protocol.md and the golden frames of the tests
#   make clean              remove what was built; make distclean removes .venv and .vm as well

# Modules are compiled once, not by each worker of the tests and each node that starts.
unexport PYTHONDONTWRITEBYTECODE

SHELL := /bin/bash
.SHELLFLAGS := -e -o pipefail -c
.DEFAULT_GOAL := bringup
.PHONY: bringup test test-cortex-m test-vm check check-style check-types check-cpp sanitize soak bench fronts accuracy stability figures screenshots parameters wheel protocol reference docs setup build clean distclean

VARIABLES := ARGS FOR FULL ONLY PYTHON SCANS SCENE SOURCE STEPS WEB
given := $(foreach variable,$(.VARIABLES),$(if $(filter command,$(origin $(variable))),$(variable)))
unknown := $(firstword $(filter-out $(VARIABLES),$(given)))
ifneq ($(unknown),)
meant := $(shell python3 -c 'import difflib, sys; print(*difflib.get_close_matches(sys.argv[1].upper(), sys.argv[2:], 1))' '$(unknown)' $(VARIABLES))
$(error unknown variable $(unknown)$(if $(meant), (did you mean $(meant)?)); known are $(VARIABLES))
endif

core := src/posfet_core
PACKAGES := src/posfet_model:src/posfet_driver:src/posfet_sim:src/posfet
IN_ENVIRONMENT := source tools/environment.sh;
SOURCES := $(shell find src launch -type f -not -name '*.pyc' -not -path '*.egg-info*')
BUILT := install/.built

ifdef ROS_DISTRO
READY := setup
CHECK_READY :=
setup:
	@tools/setup.sh
else
READY := .venv/.ready
CHECK_READY := .venv/.check_ready
setup: $(READY)
endif

.venv/.ready: tools/setup.sh tools/relocate.py tools/venv_setup.bash tools/requirements.txt tools/uv_overrides.txt
	@tools/setup.sh

build: $(BUILT)

$(BUILT): $(SOURCES) tools/build.sh | $(READY)
	@tools/build.sh

# A new .venv has none of their packages.
ifndef ROS_DISTRO
$(BUILT) benchmarks/.ready: .venv/.ready
endif

bringup: $(BUILT)
	@$(IN_ENVIRONMENT) exec posfet bringup $(if $(WEB),--web) $(if $(FOR),--for $(FOR)) $(if $(SOURCE),source:=$(SOURCE)) $(if $(SCENE),scene:=$(SCENE)) $(ARGS)

# Where pytest-xdist is, four processes run tests, on few processors, too: those that run nodes mostly wait. Linear
# algebra has one thread, as in all commands: more of them wait for each other.
test: $(BUILT)
	@$(IN_ENVIRONMENT) workers=(); \
	if python3 -c 'import xdist' 2>/dev/null; then workers=(-n 4); fi; \
	OPENBLAS_NUM_THREADS=1 exec python3 -m pytest "$${workers[@]}" $(ARGS)

# 5: no test has the name that ARGS asks for.
test-cortex-m: $(BUILT)
	@command -v qemu-system-arm >/dev/null || { echo "qemu-system-arm is missing. Install with: apt-get install qemu-system-arm" >&2; exit 1; }
	@$(MAKE) --silent -C firmware cortex-m
	@$(IN_ENVIRONMENT) python3 -m pytest -m vm test/firmware $(ARGS) || [[ $$? == 5 ]]

test-vm: $(BUILT) test-cortex-m
	@tools/vm/fetch.sh
	@$(IN_ENVIRONMENT) python3 -m pytest -m vm test/vm --collect-only -q >/dev/null  # compiled here: twenty times faster
	@exec tools/vm/run.sh python3 -m pytest -m vm test/vm $(ARGS)

# With a sourced ROS 2: pip install --requirement tools/check_requirements.txt, into an environment of your own
.venv/.check_ready: tools/check_requirements.txt | $(READY)
	@.venv/bin/uv pip install --quiet --python .venv/bin/python --requirement $< || \
	.venv/bin/python -m pip install --quiet --disable-pip-version-check --requirement $<
	@touch $@

# The three run side by side, each prints when it has ended, and all of them run whatever the others find.
check: $(BUILT) $(CHECK_READY)
	@$(MAKE) --no-print-directory --jobs=3 --output-sync=target --keep-going check-cpp check-types check-style

check-style:
	@$(IN_ENVIRONMENT) ruff check . && ruff format --check . && \
	numpydoc lint --config . $$(find src -type f -name '*.py' -not -name setup.py) && PYTHONPATH="$(PACKAGES):$$PYTHONPATH" lint-imports

check-types:
	@$(IN_ENVIRONMENT) mypy

check-cpp:
	@$(IN_ENVIRONMENT) clang-format --dry-run --Werror $$(find $(core)/src $(core)/include $(core)/fuzz -name '*.[ch]pp') && \
	tools/tidy.sh

# The interpreter is not built for it: the library of the sanitizer is loaded first, and its own leaks are no concern.
sanitize: $(BUILT)
	@$(IN_ENVIRONMENT) cmake -S $(core) -B build/sanitize -DPython3_EXECUTABLE="$$(command -v python3)" -DPOSFET_CORE_SANITIZE=ON -DBUILD_TESTING=OFF \
		-DCMAKE_INSTALL_PREFIX="$$PWD/build/sanitize/install" --no-warn-unused-cli >/dev/null; \
	cmake --build build/sanitize --parallel 2 --target scan_path --target protocol --target fuzz_protocol --target fuzz_mapped --target fuzz_scan_path --target fuzz_loop --target race_loop --target race_sink -- --no-print-directory >/dev/null; \
	build/sanitize/fuzz_protocol $(or $(FOR),20) $$RANDOM; build/sanitize/fuzz_mapped $(or $(FOR),20) $$RANDOM; build/sanitize/fuzz_scan_path $(or $(FOR),20) $$RANDOM; \
	build/sanitize/fuzz_loop $(or $(FOR),20) $$RANDOM; build/sanitize/race_loop 0; build/sanitize/race_sink; \
	mkdir -p build/sanitize/path; rm -rf build/sanitize/path/posfet_core; cp -r $(core)/posfet_core build/sanitize/path/; cp build/sanitize/scan_path.* build/sanitize/protocol.* build/sanitize/path/posfet_core/; \
	LD_PRELOAD="$$(gcc -print-file-name=libasan.so) $$(gcc -print-file-name=libubsan.so)" ASAN_OPTIONS=detect_leaks=0 PYTHONPATH="$$PWD/build/sanitize/path:$$PYTHONPATH" \
	python3 -m pytest -n0 test/core test/model/*/test_compiled_*.py test/model/contacts/test_detection.py test/model/contacts/test_tracker.py \
		test/driver/board/test_scan_loop.py test/driver/protocol/test_compiled_decoder.py test/driver/protocol/test_compiled_mapped_decoder.py test/driver/bus/test_compiled_frames.py test/driver/protocol/test_scan_assembler.py $(ARGS)

# Every part runs, whatever came of those before.
soak: $(BUILT)
	@$(IN_ENVIRONMENT) failed=(); python3 -m pytest -m slow || failed+=(tests); cd test; \
	python3 -m support.adversary --scans $(or $(SCANS),10000000) || failed+=(adversary); \
	python3 -m support.soak --for $(or $(FOR),1800) $(ARGS) || failed+=(soak); \
	if (( $${#failed[@]} )); then echo "make soak: failed: $${failed[*]}" >&2; exit 1; fi

bench: $(BUILT) benchmarks/.ready
	@$(IN_ENVIRONMENT) PYTHONPATH="$$PWD/test:$$PYTHONPATH" exec python3 -m benchmarks $(if $(FULL),--full) $(if $(ONLY),--only $(ONLY)) $(ARGS)

# Packages of the benchmarks only. With a sourced ROS 2: apt install python3-scipy python3-matplotlib; pip install cantools
benchmarks/.ready: benchmarks/requirements.txt | $(READY)
ifndef ROS_DISTRO
	@.venv/bin/python -m pip install --quiet --disable-pip-version-check --requirement $<
endif
	@touch $@

# One thread for BLAS, so that processor times compare.
fronts: $(BUILT) benchmarks/.ready
	@$(IN_ENVIRONMENT) PYTHONPATH="$$PWD/test:$$PYTHONPATH" OPENBLAS_NUM_THREADS=1 exec python3 -m benchmarks.fronts $(ARGS)

stability: $(BUILT)
	@$(IN_ENVIRONMENT) cd test && exec python3 -m support.drift $(if $(STEPS),--steps $(STEPS)) $(ARGS)

accuracy: $(BUILT)
	@$(IN_ENVIRONMENT) PYTHONPATH="$$PWD/test:$$PYTHONPATH" exec python3 -m benchmarks.accuracy $(if $(FULL),--full) $(if $(ONLY),--only $(ONLY)) $(ARGS)

figures: $(BUILT)
	@$(IN_ENVIRONMENT) exec python3 -m posfet_model.figures $(ARGS)

screenshots: $(BUILT)
	@$(IN_ENVIRONMENT) cd test && exec python3 -m support.screenshots $(ARGS)

# Without what an earlier build left: files that were removed since then would be in the wheel.
wheel: | $(READY)
	@rm -rf python/build python/posfet.egg-info
	@$(if $(ROS_DISTRO),python3,.venv/bin/python) -m pip wheel --quiet --disable-pip-version-check --no-deps --no-build-isolation --wheel-dir dist ./python
	@rm -rf python/build python/posfet.egg-info; ls -1 dist/posfet-*.whl

parameters: $(BUILT)
	@$(IN_ENVIRONMENT) exec python3 -m posfet.parameters_document $(ARGS)

reference: $(BUILT)
	@$(IN_ENVIRONMENT) exec python3 -m posfet.reference_documents $(ARGS)

# With a sourced ROS 2: pip install --requirement tools/docs_requirements.txt, into an environment of your own
.venv/.docs_ready: tools/docs_requirements.txt | $(READY)
	@.venv/bin/python -m pip install --quiet --disable-pip-version-check --requirement $<
	@touch $@

ifndef ROS_DISTRO
docs: .venv/.docs_ready
endif
docs: $(BUILT)
	@$(IN_ENVIRONMENT) NO_MKDOCS_2_WARNING=1 python3 -m mkdocs build --strict $(ARGS)
	@echo "docs: build/docs/index.html"

protocol: $(BUILT)
	@$(IN_ENVIRONMENT) exec python3 -m posfet.protocol_document $(ARGS)

clean:
	rm -rf build install log dist

distclean: clean
	rm -rf .venv .vm
