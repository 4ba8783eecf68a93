# gsid: `make help` lists the targets. Everything made goes to build/ and .venv/, except the two Python modules.

CFLAGS ?= -O2 -g
PYTHON ?= python3
WITH_FFTW ?= 1
WITH_NLOPT ?= 1
WITH_SUITESPARSE ?= 1
BUILD ?= build

VENV := .venv
PY := $(VENV)/bin/python

WARN := -Wall -Wextra -Wconversion -Wshadow -Wvla -Wmissing-prototypes -Wstrict-prototypes -Wcast-qual -Wundef
# No contraction: the same sums to the bit on every machine.
BASE_FLAGS := -std=c99 -pedantic -ffp-contract=off -fPIC -Iinclude -MMD -MP
PRECISION_double :=
PRECISION_float := -DGSID_SINGLE -Wdouble-promotion -Wunsuffixed-float-constants

CORE_SRC := $(wildcard src/core/*.c)
EFFECTS_SRC := $(wildcard src/effects/*.c)
HOST_SRC := $(wildcard src/host/*.c)
HOST_FLAGS :=
HOST_LIBS :=
ifeq ($(WITH_FFTW),1)
HOST_SRC += $(wildcard src/host/backend/fftw*.c)
HOST_FLAGS += -DGSID_WITH_FFTW
HOST_LIBS += -lfftw3 -lpthread
endif
ifeq ($(WITH_NLOPT),1)
HOST_SRC += $(wildcard src/host/backend/nlopt*.c)
HOST_FLAGS += -DGSID_WITH_NLOPT
HOST_LIBS += -lnlopt
endif
ifeq ($(WITH_SUITESPARSE),1)
HOST_SRC += $(wildcard src/host/backend/suitesparse*.c)
# Systems with a folder for its headers: as system headers, since they are not clean under our warnings.
HOST_FLAGS += -DGSID_WITH_SUITESPARSE $(addprefix -isystem ,$(addsuffix /include/suitesparse,/usr /usr/local /opt/homebrew))
HOST_LIBS += -lspqr -lcholmod -lsuitesparseconfig
endif
HOST_LIBS += -lm

HEADERS := $(wildcard include/gsid/*.h include/gsid/host/*.h)
C_FILES := $(wildcard src/*/*.[ch] src/*/*/*.[ch] tests/c/*.[ch] benchmarks/*.c)
CORE_LIBS := $(BUILD)/double/libgsid_core.a $(BUILD)/float/libgsid_core.a
EFFECTS_LIBS := $(BUILD)/double/libgsid_effects.a $(BUILD)/float/libgsid_effects.a
HOST_LIB := $(BUILD)/libgsid_host.a
MODULES := python/gsid/_gsid64.abi3.so python/gsid/_gsid32.abi3.so

.DELETE_ON_ERROR:
.SUFFIXES:
.PHONY: all
all: $(BUILD)/installed.stamp $(MODULES) ## build everything and make the command .venv/bin/gsid (the default)

.PHONY: help
help: ## list the targets
	@sed -n 's/^\([a-z-]*\):.*## /  \1\t/p' $(MAKEFILE_LIST) | expand -t 16
	@echo
	@echo "  Variables: CC CXX AR CFLAGS LDFLAGS PYTHON; WITH_FFTW=0, WITH_NLOPT=0, WITH_SUITESPARSE=0 leave a library out."

# ---- set-up ------------------------------------------------------------------------------------------------------

.PHONY: setup
setup: build/setup.stamp $(VENV)/requirements.stamp ## install what is missing: system packages, then .venv

build/setup.stamp: tools/setup build/with.txt
	CC="$(CC)" CXX="$(CXX)" CFLAGS="$(CFLAGS)" PYTHON="$(PYTHON)" WITH_FFTW=$(WITH_FFTW) WITH_NLOPT=$(WITH_NLOPT) WITH_SUITESPARSE=$(WITH_SUITESPARSE) \
	    tools/setup
	@touch $@

$(VENV)/requirements.stamp: requirements.txt | build/setup.stamp
	@test -x $(PY) || $(PYTHON) -m venv $(VENV)
	@echo "$(PY) -m pip install -r requirements.txt"
	@$(PY) -m pip install -q --disable-pip-version-check -r requirements.txt || \
	    { echo "error: the Python packages of requirements.txt could not be installed" >&2; \
	      echo "hint: the first build needs a network, or a folder of wheels in PIP_FIND_LINKS" >&2; exit 1; }
	@touch $@

# ---- C libraries -------------------------------------------------------------------------------------------------

.PHONY: libs
libs: $(CORE_LIBS) $(EFFECTS_LIBS) $(HOST_LIB) ## build the C libraries only (no Python needed)

# Files that change only when the settings do, so that other settings rebuild and the same ones do not.
settings = @mkdir -p $(@D); echo '$(1)' | cmp -s - $@ || echo '$(1)' > $@
.PHONY: FORCE
$(BUILD)/flags.txt: FORCE
	$(call settings,$(CC) $(AR) $(CFLAGS) $(HOST_FLAGS))
build/with.txt: FORCE
	$(call settings,$(HOST_FLAGS))

$(BUILD)/core.txt: FORCE
	$(call settings,$(CORE_SRC))
$(BUILD)/effects.txt: FORCE
	$(call settings,$(EFFECTS_SRC))
$(BUILD)/host.txt: FORCE
	$(call settings,$(HOST_SRC))

define core_rules
$(BUILD)/$(1)/libgsid_core.a: $(CORE_SRC:src/%.c=$(BUILD)/$(1)/%.o) $(BUILD)/core.txt
	@rm -f $$@
	$(AR) rcs $$@ $$(filter %.o,$$^)
$(BUILD)/$(1)/libgsid_effects.a: $(EFFECTS_SRC:src/%.c=$(BUILD)/$(1)/%.o) $(BUILD)/effects.txt
	@rm -f $$@
	$(AR) rcs $$@ $$(filter %.o,$$^)
$(BUILD)/$(1)/%.o: src/%.c $(BUILD)/flags.txt
	@mkdir -p $$(@D)
	$(CC) $(BASE_FLAGS) $(WARN) $(PRECISION_$(1)) $(CFLAGS) -c -o $$@ $$<
endef
$(foreach precision,double float,$(eval $(call core_rules,$(precision))))

$(HOST_LIB): $(HOST_SRC:src/%.c=$(BUILD)/%.o) $(BUILD)/host.txt
	@rm -f $@
	$(AR) rcs $@ $(filter %.o,$^)
$(BUILD)/host/%.o: src/host/%.c $(BUILD)/flags.txt | build/setup.stamp
	@mkdir -p $(@D)
	$(CC) $(BASE_FLAGS) $(WARN) $(HOST_FLAGS) $(CFLAGS) -c -o $@ $<

# ---- installation ------------------------------------------------------------------------------------------------
# CMakeLists.txt knows what is installed, because its package needs to know that too.

PREFIX ?= /usr/local
DESTDIR ?=
.PHONY: install
install: ## headers, static and shared libraries, gsid.pc and the CMake package into PREFIX, below DESTDIR (needs cmake)
	cmake -S . -B $(BUILD)/cmake -DCMAKE_BUILD_TYPE=None -DCMAKE_C_COMPILER='$(firstword $(CC))' -DCMAKE_C_FLAGS='$(wordlist 2,9,$(CC)) $(CFLAGS)' \
	    -DCMAKE_INSTALL_PREFIX='$(abspath $(PREFIX))' -DCMAKE_INSTALL_LIBDIR=lib \
	    -DGSID_WITH_FFTW=$(WITH_FFTW) -DGSID_WITH_NLOPT=$(WITH_NLOPT) -DGSID_WITH_SUITESPARSE=$(WITH_SUITESPARSE)
	cmake --build $(BUILD)/cmake -j$(shell getconf _NPROCESSORS_ONLN 2>/dev/null || echo 1)
	DESTDIR='$(DESTDIR)' cmake --install $(BUILD)/cmake

.PHONY: uninstall
uninstall: ## remove what `make install` with the same PREFIX and DESTDIR has put there
	@test -f $(BUILD)/cmake/install_manifest.txt || { echo "error: nothing was installed from this folder" >&2; \
	    echo "hint: \`make install\` with the same PREFIX and DESTDIR first" >&2; exit 1; }
	sed 's|.*|$(DESTDIR)&|' $(BUILD)/cmake/install_manifest.txt | tr '\n' '\0' | xargs -0 rm -f
	-cd '$(DESTDIR)$(abspath $(PREFIX))' && rmdir include/gsid/host include/gsid lib/cmake/gsid

.PHONY: amalgamation
amalgamation: ## core and effects as two files, gsid.c and gsid.h, in build/amalgamation
	$(PYTHON) tools/amalgamate $(BUILD)/amalgamation
	@echo "$(BUILD)/amalgamation/gsid.c $(BUILD)/amalgamation/gsid.h"

# ---- Python modules ----------------------------------------------------------------------------------------------

$(BUILD)/python/_gsid%.c: python/gsid_build.py $(HEADERS) $(VENV)/requirements.stamp
	@mkdir -p $(@D)
	CC="$(CC)" $(PY) python/gsid_build.py $* $@
	@touch $@ # cffi leaves a file alone that would not change

# Undefined symbols are left to the interpreter: a shared object may have them.
ifeq ($(shell uname -s),Darwin)
MODULE_LINK := -bundle -undefined dynamic_lookup
else
MODULE_LINK := -shared
endif
module = $(CC) -fPIC $(MODULE_LINK) $(CFLAGS) -Iinclude -I$$($(PY) -c 'import sysconfig; print(sysconfig.get_path("include"))') \
	-o $@ $(filter %.c %.a,$^) $(LDFLAGS)
python/gsid/_gsid64.abi3.so: $(BUILD)/python/_gsid64.c $(HOST_LIB) $(BUILD)/double/libgsid_effects.a $(BUILD)/double/libgsid_core.a
	$(module) $(HOST_LIBS)
python/gsid/_gsid32.abi3.so: $(BUILD)/python/_gsid32.c $(BUILD)/float/libgsid_effects.a $(BUILD)/float/libgsid_core.a
	$(module) -lm

# types.h has the version.
$(BUILD)/installed.stamp: pyproject.toml include/gsid/types.h $(VENV)/requirements.stamp
	GSID_MODULES_OF_MAKE=1 $(PY) -m pip install -q --disable-pip-version-check --no-build-isolation --no-deps --no-index -e .
	@touch $@

# ---- the program -------------------------------------------------------------------------------------------------

.PHONY: demo
demo: all ## measure, fit and compare a simulated axis, find what is hidden in it, and write a report
	$(VENV)/bin/gsid demo

.PHONY: pictures
HIDDEN := $(foreach i,1 2 3 4 5 6,demo/hidden$(i).csv)
pictures: demo ## draw the pictures of README.md from what the demo measured
	$(VENV)/bin/gsid fit --model demo/initial_model.json $(HIDDEN) -o demo/fitted.json
	$(VENV)/bin/gsid compare --model demo/fitted.json demo/hidden7.csv --plot docs/pictures/where.png
	$(VENV)/bin/gsid add quadratic_drag --model demo/initial_model.json $(HIDDEN) --held-out demo/hidden7.csv \
	    --held-out demo/hidden8.csv -o demo/added.json --plot docs/pictures/ladder.png
	$(PY) tools/draw_before_after --before demo/fitted.json --after demo/added.json demo/hidden7.csv \
	    -o docs/pictures/before_after.png

# ---- tests -------------------------------------------------------------------------------------------------------
# tests/c/test_host_*.c link the host library, the others core and effects, once in each precision.

HOST_TESTS := $(patsubst tests/c/%.c,$(BUILD)/tests/%,$(wildcard tests/c/test_host_*.c))
CORE_TESTS := $(filter-out test_host_%,$(patsubst tests/c/%.c,%,$(wildcard tests/c/test_*.c)))
# The longest first: those of the host.
C_TESTS := $(HOST_TESTS) $(CORE_TESTS:%=$(BUILD)/double/tests/%) $(CORE_TESTS:%=$(BUILD)/float/tests/%)
TEST_FLAGS := $(BASE_FLAGS) -Wall -Wextra

define test_rule
$(BUILD)/$(1)/tests/%: tests/c/%.c $(BUILD)/$(1)/libgsid_effects.a $(BUILD)/$(1)/libgsid_core.a | build/setup.stamp
	@mkdir -p $$(@D)
	$(CC) $(TEST_FLAGS) $(filter -D%,$(PRECISION_$(1))) $(CFLAGS) -o $$@ $$(filter %.c %.a,$$^) $(LDFLAGS) -lcmocka -lm
endef
$(foreach precision,double float,$(eval $(call test_rule,$(precision))))

$(BUILD)/tests/%: tests/c/%.c $(HOST_LIB) $(BUILD)/double/libgsid_effects.a $(BUILD)/double/libgsid_core.a | build/setup.stamp
	@mkdir -p $(@D)
	$(CC) $(TEST_FLAGS) $(HOST_FLAGS) $(CFLAGS) -o $@ $(filter %.c %.a,$^) $(LDFLAGS) -lcmocka $(HOST_LIBS)

# One process for each processor, unless make was called with -j. The steps follow one another, so that their outputs do not mix.
JOBS = $(if $(filter -j%,$(MAKEFLAGS)),,-j$(shell getconf _NPROCESSORS_ONLN 2>/dev/null || echo 1))

.PHONY: test
test: setup ## C in double and float, the same sanitized and under valgrind, then Python but for the long tests
	$(MAKE) $(JOBS) tests-built
	$(MAKE) check
	$(MAKE) sanitize
	$(MAKE) valgrind
	$(PY) -m pytest -q -n auto --dist loadgroup -m "not long and not trial"

.PHONY: test-long
test-long: all peers ## tests that simulate whole studies, or build gsid anew: those marked long (minutes)
	$(PY) -m pytest -q -n auto --dist loadgroup -m long

.PHONY: test-trials
test-trials: all ## trials that a study of the diagnosis has lost, diagnosed again (minutes)
	$(PY) -m pytest -q -n auto --dist loadgroup -m trial

.PHONY: tests-built
tests-built: all peers $(C_TESTS) sanitized-built

$(VENV)/browser.stamp: tests/browser/requirements.txt $(VENV)/requirements.stamp
	tools/setup browser
	$(PY) -m pip install -q --disable-pip-version-check -r tests/browser/requirements.txt
	@touch $@

.PHONY: test-browser
test-browser: all $(VENV)/browser.stamp ## the page of gsid studio in a real browser, by clicks alone
	GSID_BROWSER=1 $(PY) -m pytest -q tests/browser

.PHONY: studio-pictures
studio-pictures: all $(VENV)/browser.stamp ## screenshots of the page for the documentation, into docs/pictures
	GSID_BROWSER=1 GSID_PICTURES=docs/pictures $(PY) -m pytest -q tests/browser/test_demo_story.py

.PHONY: studio
studio: all ## open the page of gsid studio
	$(VENV)/bin/gsid studio

build/install.stamp: tools/setup
	tools/setup install
	@mkdir -p $(@D) && touch $@

build/install-tools/.stamp: tests/install/requirements.txt $(VENV)/requirements.stamp
	$(PYTHON) -m venv $(@D)
	$(@D)/bin/python -m pip install -q --disable-pip-version-check -r tests/install/requirements.txt
	@touch $@

.PHONY: install-tools
install-tools: build/install.stamp build/install-tools/.stamp ## what the tests of an installation need beside the build

.PHONY: test-install
test-install: all install-tools ## projects that use gsid as each kind of user installs it
	$(PY) -m pytest -q tests/install

BASE ?=
.PHONY: abi-check
abi-check: build/install.stamp ## compare the ABI of the shared libraries with the newest tag, or BASE, by abidiff
	tools/abi_check $(BASE)

.PHONY: wheel
wheel: build/install-tools/.stamp ## sdist and wheel without GPL libraries, into build/wheel
	@rm -rf $(BUILD)/wheel
	WITH_FFTW=0 WITH_SUITESPARSE=0 build/install-tools/bin/python -m build --no-isolation -o $(BUILD)/wheel/raw .
	PATH="$(abspath build/install-tools/bin):$$PATH" build/install-tools/bin/auditwheel repair $(BUILD)/wheel/raw/*.whl -w $(BUILD)/wheel
	mv $(BUILD)/wheel/raw/*.tar.gz $(BUILD)/wheel

.PHONY: test-wheel
test-wheel: all wheel ## the wheel in a bare virtual environment: the demo, and licences (minutes)
	GSID_WHEEL=$(BUILD)/wheel $(PY) -m pytest -q -s tests/install/test_wheel.py

.PHONY: test-data
test-data: all ## the tests on measured records, those of docs/how-to/real_data.md that take minutes too
	GSID_SLOW_DATA=1 $(PY) -m pytest -q tests/build/test_real_data.py

.PHONY: check
check: $(C_TESTS) ## the C tests, in double and float
	tools/run_c_tests $(C_TESTS)

SANITIZE := -O1 -g -fno-omit-frame-pointer -fsanitize=address,undefined -fno-sanitize-recover=all
SANITIZED = BUILD=$(BUILD)/sanitize CFLAGS='$(SANITIZE)'
.PHONY: sanitize
sanitize: build/setup.stamp ## the C tests under AddressSanitizer and UndefinedBehaviorSanitizer
	$(MAKE) $(SANITIZED) check

.PHONY: sanitized-built c-tests-built
sanitized-built: build/setup.stamp
	$(MAKE) $(SANITIZED) c-tests-built
c-tests-built: $(C_TESTS)

.PHONY: valgrind
valgrind: $(C_TESTS) ## the C tests under valgrind
	@if command -v valgrind >/dev/null; then \
	    tools/run_c_tests --valgrind $(C_TESTS); \
	else echo "skipped: the C tests under valgrind, since there is no valgrind"; fi

include tests/blind/blind.mk
include tests/first_stage/first_stage.mk
include tests/false_alarms/false_alarms.mk
include tests/structure/structure.mk
include tests/interrupted/interrupted.mk
include tests/mutants/mutants.mk
include tests/fleet/fleet.mk
include firmware_examples/firmware.mk

# Hardening that some systems' compilers add would bring symbols into the core that are not of its own making.
LINT_FLAGS := -O2 -Werror -fno-stack-protector -U_FORTIFY_SOURCE
.PHONY: lint
lint: $(VENV)/requirements.stamp ## warnings as errors, layers, symbols, headers alone, wording, Python style and types
	$(MAKE) BUILD=$(BUILD)/lint CFLAGS='$(LINT_FLAGS)' libs
	CC="$(CC)" CXX="$(CXX)" $(PY) tools/check_layers $(CORE_LIBS:$(BUILD)/%=--core $(BUILD)/lint/%) \
	    $(EFFECTS_LIBS:$(BUILD)/%=--effects $(BUILD)/lint/%) \
	    --host $(BUILD)/lint/libgsid_host.a
	$(PY) tools/check_wording
	$(VENV)/bin/ruff check -q .
	$(VENV)/bin/ruff format -q --check .
	$(VENV)/bin/mypy --no-error-summary
	$(VENV)/bin/clang-format --dry-run -Werror $(C_FILES)

.PHONY: format
format: $(VENV)/requirements.stamp ## lay out C sources and Python by .clang-format and pyproject.toml
	$(VENV)/bin/clang-format -i $(C_FILES)
	$(VENV)/bin/ruff format -q .

# Without a network the benchmarks and the tests beside peers report what is missing.
.PHONY: peers
peers: build/peers/.stamp ## install the packages that benchmarks and tests compare with, into build/peers
build/peers/.stamp: benchmarks/requirements.txt $(VENV)/requirements.stamp
	@rm -rf $(@D)
	@echo "$(PY) -m pip install --target $(@D) -r benchmarks/requirements.txt"
	@if $(PY) -m pip install -q --disable-pip-version-check --no-deps --ignore-requires-python --target $(@D) \
	    -r benchmarks/requirements.txt; then touch $@; else echo "no peers: they could not be installed" >&2; fi

.PHONY: bench
bench: all peers ## run the benchmarks; each prints its figures and versions as JSON
	@for bench in benchmarks/bench_*.py; do echo "$$bench" >&2; PYTHONPATH=build/peers $(PY) $$bench || exit 1; done

.PHONY: bench-live
bench-live: all ## cost of the server of gsid studio while an experiment runs (minutes)
	$(PY) benchmarks/live_server.py

.PHONY: bench-fit
bench-fit: all peers ## fits beside scipy, scikit-rf and Octave, and every estimator from 200 starts, into docs/explanation/estimators.md (minutes)
	@tools/setup peers || echo "bench-fit: without Octave" >&2
	$(PY) benchmarks/bench_fit.py --page docs/explanation/estimators.md
	$(PY) benchmarks/bench_estimators.py --page docs/explanation/estimators.md

.PHONY: coverage
coverage: all ## how often the intervals of fits hold the truth (minutes); fails outside 93 to 97 %
	$(PY) benchmarks/coverage_fit.py

.PHONY: coverage-mimo
coverage-mimo: all ## the same for common poles, delays and responses of a simulated 4 x 4 gimbal (minutes)
	$(PY) tests/python/mimo_coverage.py

.PHONY: minima-study
minima-study: all ## how often a free delay of a random damped axis ends in a wrong minimum, and is reported (minutes)
	$(PY) tests/python/damped_axes.py

.PHONY: settings-study
settings-study: all ## how the numerical settings of the grey-box fit change its results (minutes)
	$(PY) benchmarks/greybox_settings.py

.PHONY: distortion-study
distortion-study: all ## how well the intervals of gsid.distortion cover a known truth (a minute)
	$(PY) tests/python/distortion_study.py

.PHONY: joined-study
joined-study: all ## coverage of the intervals of bands that were measured apart and joined (a minute)
	$(PY) tests/python/joined_bands.py

# Chapters are steps: an interrupted study goes on behind the last one. A change of gsid begins it anew.
THESIS := $(BUILD)/thesis
THESIS_CHAPTERS := $(patsubst benchmarks/thesis/%.py,$(THESIS)/%.json,$(wildcard benchmarks/thesis/chapter*.py))
.PHONY: thesis
thesis: $(THESIS_CHAPTERS) ## the study of the thesis on the simulated axis, into docs/reference/thesis_study.md (minutes)
	$(PY) benchmarks/thesis/write_page.py $(THESIS)
$(THESIS)/.stamp: $(BUILD)/installed.stamp $(MODULES) $(wildcard python/gsid/*.py python/gsid/*/*.py python/gsid/*/*/*.py)
	@rm -rf $(THESIS)
	@mkdir -p $(THESIS) && touch $@
$(THESIS)/%.json: benchmarks/thesis/%.py benchmarks/thesis/thesis_study.py $(THESIS)/.stamp
	$(PY) benchmarks/thesis/run_chapter.py $* $(THESIS)

.PHONY: hostile
hostile: all ## bad input of every kind through every verb that reads it, with limits of time and memory (hours; resumes)
	$(PY) tests/hostile/hostile_runs.py --out $(BUILD)/hostile.jsonl

# The site needs no network; its packages do, once.
$(VENV)/docs.stamp: docs/requirements.txt $(VENV)/requirements.stamp
	@echo "$(PY) -m pip install -r docs/requirements.txt"
	@$(PY) -m pip install -q --disable-pip-version-check -r docs/requirements.txt
	@touch $@

.PHONY: docs
docs: all $(VENV)/docs.stamp ## build the documentation into build/docs; a warning is an error
	@rm -rf $(BUILD)/docs
	$(VENV)/bin/sphinx-build -q -E -W --keep-going -b html -d $(BUILD)/docs-cache docs $(BUILD)/docs
	@! grep -rnoE '<(script|link|img)[^>]*(src|href)="(https?:)?//[^"]*"' --include='*.html' $(BUILD)/docs || \
	    { echo "error: the site loads files from a network" >&2; exit 1; }
	@echo "$(BUILD)/docs/index.html"

.PHONY: effects-page
effects-page: all ## make docs/reference/effects.md anew from the descriptors of the effects
	$(PY) tools/make_effects_page > docs/reference/effects.md

.PHONY: errors-page
errors-page: all ## make docs/reference/errors.md anew from the list of status codes
	$(PY) tools/make_errors_page > docs/reference/errors.md

.PHONY: clean
clean: ## remove what was built; .venv stays
	rm -rf build $(MODULES)

-include $(wildcard $(addprefix $(BUILD)/,*/*.d */*/*.d))
