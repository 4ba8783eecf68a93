# The firmware examples. Needs the variables of the Makefile that includes it.
# Those for a computer are part of `make test`; those for Cortex-M need a cross compiler and an emulator, and are not.

EXAMPLES := $(BUILD)/firmware/minimal $(BUILD)/firmware/posix
EXAMPLE_FLAGS := $(BASE_FLAGS) $(WARN) $(PRECISION_float)
RATE_LOOP := firmware_examples/rate_loop/experiment.c

$(BUILD)/firmware/minimal: firmware_examples/minimal/main.c
$(BUILD)/firmware/posix: firmware_examples/posix/main.c $(RATE_LOOP)
$(EXAMPLES): $(BUILD)/float/libgsid_effects.a $(BUILD)/float/libgsid_core.a
	@mkdir -p $(@D)
	$(CC) $(EXAMPLE_FLAGS) $(CFLAGS) -o $@ $(filter %.c,$^) $(filter %.a,$^) $(LDFLAGS) -lm

.PHONY: examples
examples: $(EXAMPLES) ## the firmware examples that run on a computer
test: $(EXAMPLES)
C_FILES += $(wildcard firmware_examples/*/*.[ch])
