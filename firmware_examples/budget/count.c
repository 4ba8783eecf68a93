/* Plugin for QEMU 7 and 8 that counts the instructions between two functions of the image. For each run from `begin` to `end`
 * it writes a line with the number of instructions; for each call of `case` it writes a line with a dash. The plugin interface
 * (version 1) is declared here because its header is not packaged.
 *
 *     qemu-system-arm ... -plugin file=count.so,case=ADDRESS,begin=ADDRESS,end=ADDRESS,out=FILE
 *
 * The number includes the calls of `begin` and `end` themselves. Measure an empty run to obtain that overhead. */
#include <inttypes.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define EXPORT __attribute__((visibility("default")))
typedef uint64_t plugin_id;
struct tb;
struct insn;
EXPORT extern int qemu_plugin_version;
EXPORT int qemu_plugin_install(plugin_id id, const void *info, int argc, char **argv);
void qemu_plugin_register_vcpu_tb_trans_cb(plugin_id id, void (*callback)(plugin_id, struct tb *));
void qemu_plugin_register_atexit_cb(plugin_id id, void (*callback)(plugin_id, void *), void *user);
size_t qemu_plugin_tb_n_insns(const struct tb *tb);
struct insn *qemu_plugin_tb_get_insn(const struct tb *tb, size_t i);
uint64_t qemu_plugin_insn_vaddr(const struct insn *insn);
void qemu_plugin_register_vcpu_insn_exec_inline(struct insn *insn, int operation, void *counter, uint64_t amount);
void qemu_plugin_register_vcpu_insn_exec_cb(struct insn *insn, void (*callback)(unsigned, void *), int flags,
                                            void *user);

EXPORT int qemu_plugin_version = 1;

enum { CASE, BEGIN, END, N_MARKS };
static const char *const names[N_MARKS] = {"case=", "begin=", "end="};
static uint64_t address[N_MARKS], n_executed, n_at_begin;
static FILE *out;

static void at_case(unsigned cpu, void *user) {
    (void)cpu, (void)user;
    fputs("-\n", out);
}

static void at_begin(unsigned cpu, void *user) {
    (void)cpu, (void)user;
    n_at_begin = n_executed;
}

static void at_end(unsigned cpu, void *user) {
    (void)cpu, (void)user;
    fprintf(out, "%" PRIu64 "\n", n_executed - n_at_begin);
}

static void (*const marks[N_MARKS])(unsigned, void *) = {at_case, at_begin, at_end};

static void translate(plugin_id id, struct tb *tb) {
    (void)id;
    for (size_t i = 0; i < qemu_plugin_tb_n_insns(tb); i++) {
        struct insn *insn = qemu_plugin_tb_get_insn(tb, i);
        for (int mark = 0; mark < N_MARKS; mark++) {
            if (qemu_plugin_insn_vaddr(insn) == address[mark]) {
                qemu_plugin_register_vcpu_insn_exec_cb(insn, marks[mark], 0, NULL);
            }
        }
        qemu_plugin_register_vcpu_insn_exec_inline(insn, 0, &n_executed, 1);
    }
}

static void finish(plugin_id id, void *user) {
    (void)id, (void)user;
    fclose(out);
}

int qemu_plugin_install(plugin_id id, const void *info, int argc, char **argv) {
    (void)info;
    for (int i = 0; i < argc; i++) {
        for (int mark = 0; mark < N_MARKS; mark++) {
            if (strncmp(argv[i], names[mark], strlen(names[mark])) == 0) {
                address[mark] = strtoull(argv[i] + strlen(names[mark]), NULL, 0) & ~UINT64_C(1); /* Thumb bit */
            }
        }
        if (strncmp(argv[i], "out=", 4) == 0) {
            out = fopen(argv[i] + 4, "w");
        }
    }
    if (out == NULL || !address[CASE] || !address[BEGIN] || !address[END]) {
        return -1;
    }
    qemu_plugin_register_vcpu_tb_trans_cb(id, translate);
    qemu_plugin_register_atexit_cb(id, finish, NULL);
    return 0;
}
