# The blind trials' own simulator, and the trials. Needs the variables of the Makefile that includes it.

TRUTH := $(BUILD)/blind/libtruth.so
$(TRUTH): tests/blind/truth.c tests/blind/truth.h $(BUILD)/flags.txt
	@mkdir -p $(@D)
	$(CC) $(BASE_FLAGS) $(WARN) $(CFLAGS) -shared -o $@ $< $(LDFLAGS) -lm

test: $(TRUTH)

N ?= 100
SEED ?= 1
.PHONY: blind
blind: all $(TRUTH) ## N blind trials of diagnose with seed SEED, scored into build/blind/
	$(PY) tests/blind/score.py --trials $(N) --seed $(SEED) --output $(BUILD)/blind/$(SEED)
