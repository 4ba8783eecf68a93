# The blind trials' own simulator, and the trials. Needs the variables of the Makefile that includes it.

TRUTH := $(BUILD)/blind/libtruth.so
$(TRUTH): tests/blind/truth.c tests/blind/truth.h $(BUILD)/flags.txt
	@mkdir -p $(@D)
	$(CC) $(BASE_FLAGS) $(WARN) $(CFLAGS) -shared -o $@ $< $(LDFLAGS) -lm

tests-built: $(TRUTH)
C_FILES += tests/blind/truth.c tests/blind/truth.h

N ?= 100
SEED ?= 1
KINDS ?=
CHECK ?=
.PHONY: blind
blind: all $(TRUTH) ## N blind trials of diagnose, drawn from SEED (KINDS=null,...; CHECK=1 fails on a missed figure)
	$(PY) tests/blind/score.py --trials $(N) --seed $(SEED) --output $(BUILD)/blind/$(SEED) \
	    $(KINDS:%=--kinds %) $(if $(CHECK),--check)
