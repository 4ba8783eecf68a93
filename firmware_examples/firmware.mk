# The firmware examples. Needs the variables of the Makefile that includes it.
# Those for a computer are part of `make test`; those for Cortex-M need a cross compiler and an emulator: `.ci/run` calls
# `make test-firmware` for them.

EXAMPLES := $(BUILD)/firmware/minimal $(BUILD)/firmware/posix
EXAMPLE_FLAGS := $(BASE_FLAGS) $(WARN) $(PRECISION_float)
RATE_LOOP := firmware_examples/rate_loop/experiment.c
# The drive of the bare-metal image, compiled for a computer: a test compares the bytes that both send to the same axis.
REPLAY := $(BUILD)/firmware/replay

$(BUILD)/firmware/minimal: firmware_examples/minimal/main.c
$(BUILD)/firmware/posix: firmware_examples/posix/main.c $(RATE_LOOP)
$(EXAMPLES): $(BUILD)/float/libgsid_effects.a $(BUILD)/float/libgsid_core.a
	@mkdir -p $(@D)
	$(CC) $(EXAMPLE_FLAGS) $(CFLAGS) -o $@ $(filter %.c,$^) $(filter %.a,$^) $(LDFLAGS) -lm

$(REPLAY): firmware_examples/tests/replay.c $(wildcard firmware_examples/rate_loop/*.[ch]) $(BUILD)/float/libgsid_core.a
	$(CC) $(EXAMPLE_FLAGS) $(CFLAGS) -o $@ $(filter %.c %.a,$^) $(LDFLAGS) -lm

.PHONY: examples
examples: $(EXAMPLES) ## the firmware examples that run on a computer
tests-built: $(EXAMPLES)
C_FILES += $(wildcard firmware_examples/*/*.[ch] firmware_examples/cfs/fsw/src/*.[ch] tests/install/*/*.[ch])

# ---- Cortex-M ----------------------------------------------------------------------------------------------------

ARM_CC := arm-none-eabi-gcc
ARM_FLAGS := -std=c99 -pedantic -ffp-contract=off -Iinclude -MMD -MP -Os -g -mthumb -mfloat-abi=hard \
    -ffunction-sections -fdata-sections -fno-math-errno -fstack-usage $(WARN) $(PRECISION_float) -Werror
ARM_LINK := -nostartfiles --specs=nano.specs -Wl,--gc-sections -T firmware_examples/cortex_m7/mps2.ld
# Single precision only on both, so that on the M4F an instruction in double would fault.
# Not -ffreestanding: it turns square root and fused multiply-add, one instruction each, into function calls.
CPU_m7 := -mcpu=cortex-m7 -mfpu=fpv5-sp-d16
CPU_m4 := -mcpu=cortex-m4 -mfpu=fpv4-sp-d16

# full: the whole measurement, with a long timeout, because the simulated axis may pause on a busy computer. short: a shorter
# measurement, for tests of faults on the line. tests/build/test_firmware_examples.py tests the timeout of the drive as shipped.
SIZE_full := -DDRIVE_SILENCE_MS=60000
SIZE_short := -DEXPERIMENT_SHORT -DDRIVE_SILENCE_MS=1000

BOARD := $(wildcard firmware_examples/cortex_m7/*.c)
FIRMWARE_SRC := $(BOARD) $(wildcard firmware_examples/rate_loop/*.c) $(CORE_SRC)

# $(1): CPU, $(2): size
define image_rules
$(BUILD)/firmware/$(1)-$(2).elf: $(FIRMWARE_SRC:%.c=$(BUILD)/firmware/$(1)-$(2)/%.o) firmware_examples/cortex_m7/mps2.ld
	$(ARM_CC) $(CPU_$(1)) $(ARM_FLAGS) $(ARM_LINK) -Wl,-Map=$$@.map -o $$@ $$(filter %.o,$$^) -lm
$(BUILD)/firmware/$(1)-$(2)/%.o: %.c firmware_examples/firmware.mk $(BUILD)/firmware/setup.stamp
	@mkdir -p $$(@D)
	$(ARM_CC) $(CPU_$(1)) $(ARM_FLAGS) $(SIZE_$(2)) -c -o $$@ $$<
endef
IMAGES := m7-full m4-full m7-short m4-short
$(foreach image,$(IMAGES),$(eval $(call image_rules,$(firstword $(subst -, ,$(image))),$(lastword $(subst -, ,$(image))))))

$(BUILD)/firmware/setup.stamp: tools/setup
	tools/setup firmware
	@mkdir -p $(@D) && touch $@

# ---- budget ------------------------------------------------------------------------------------------------------

BUDGET_SRC := firmware_examples/budget/main.c $(filter-out %/main.c,$(BOARD)) $(CORE_SRC) $(EFFECTS_SRC)
define budget_rules
$(BUILD)/firmware/$(1)-budget.elf: $(BUDGET_SRC:%.c=$(BUILD)/firmware/$(1)-full/%.o) firmware_examples/cortex_m7/mps2.ld
	$(ARM_CC) $(CPU_$(1)) $(ARM_FLAGS) $(ARM_LINK) -o $$@ $$(filter %.o,$$^) -lm
	@echo '$(CPU_$(1)) -mthumb -mfloat-abi=hard' > $(BUILD)/firmware/$(1).flags
endef
$(foreach cpu,m7 m4,$(eval $(call budget_rules,$(cpu))))

$(BUILD)/firmware/count.so: firmware_examples/budget/count.c
	@mkdir -p $(@D)
	$(CC) -std=c99 -O2 -fPIC -shared -fvisibility=hidden -o $@ $<

COUNTED := $(BUILD)/firmware/m7-budget.elf $(BUILD)/firmware/m4-budget.elf $(BUILD)/firmware/count.so
.PHONY: size
size: all firmware $(COUNTED) ## measure code size, stack and time of the firmware: update docs/reference/budget.md
	$(PY) tools/firmware_budget > $(BUILD)/firmware/budget.md
	@cp $(BUILD)/firmware/budget.md docs/reference/budget.md
	@cat docs/reference/budget.md
	@git diff --unified=0 -- docs/reference/budget.md

.PHONY: firmware
firmware: $(IMAGES:%=$(BUILD)/firmware/%.elf) ## cross-build the example firmware for Cortex-M7 and M4F
-include $(shell find $(BUILD)/firmware -name '*.d' 2>/dev/null)

.PHONY: test-firmware
test-firmware: all firmware $(COUNTED) $(REPLAY) ## run the firmware in an emulator, in lock-step with a simulated axis
	$(PY) -m pytest -q -s -rs firmware_examples/tests
