# Mutants of the sources, judged by the tests that execute their lines. Needs the variables of the Makefile that includes it.

MUTANTS := build/mutants/packages
$(MUTANTS)/.stamp: tests/mutants/requirements.txt $(VENV)/requirements.stamp
	@rm -rf $(MUTANTS)
	@echo "$(PY) -m pip install --target $(MUTANTS) -r $<"
	@if $(PY) -m pip install -q --disable-pip-version-check --no-deps --target $(MUTANTS) -r $<; then touch $@; \
	    else echo "no mutants: their packages could not be installed" >&2; fi

tests-built: $(MUTANTS)/.stamp

MINUTES ?= 120
.PHONY: mutants
mutants: all $(TRUTH) $(MUTANTS)/.stamp ## which of 200 small faults in each of four parts the tests find (MINUTES=120; goes on where it was stopped; PART=diagnosis)
	PYTHONPATH=$(MUTANTS) $(PY) tests/mutants/run_mutants.py --minutes $(MINUTES) $(PART:%=--target %) --page docs/explanation/mutants.md
