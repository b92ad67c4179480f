/* A plugin of qemu: counts the instructions of a program for 64-bit ARM, by kind (scripts/count-arm64).
 *
 * The declarations are those of qemu's qemu-plugin.h, interface version 1, which Debian does not package. */
#include <inttypes.h>
#include <stddef.h>
#include <stdio.h>

struct tb;
struct insn;
void qemu_plugin_register_vcpu_tb_trans_cb(uint64_t id, void (*translated)(uint64_t, struct tb *));
void qemu_plugin_register_atexit_cb(uint64_t id, void (*ended)(uint64_t, void *), void *data);
void qemu_plugin_register_vcpu_tb_exec_inline(struct tb *, int add, void *to, uint64_t count);
size_t qemu_plugin_tb_n_insns(const struct tb *);
struct insn *qemu_plugin_tb_get_insn(const struct tb *, size_t);
const void *qemu_plugin_insn_data(const struct insn *);

__attribute__((visibility("default"))) int qemu_plugin_version = 1;

enum kind { LOAD_STORE, FLOAT_VECTOR, BRANCH, INTEGER, KINDS };
static uint64_t counts[KINDS];

/* By the main groups of the encoding: bits 28 to 25. */
static enum kind kind_of(uint32_t word)
{
    unsigned group = word >> 25 & 15;
    if ((group & 5) == 4)
        return LOAD_STORE;
    if ((group & 7) == 7)
        return FLOAT_VECTOR;
    return (group & 14) == 10 ? BRANCH : INTEGER;
}

/* Each block adds what it holds whenever it runs. */
static void translated(uint64_t id, struct tb *block)
{
    uint64_t held[KINDS] = { 0 };
    for (size_t k = 0; k < qemu_plugin_tb_n_insns(block); k++)
        held[kind_of(*(const uint32_t *)qemu_plugin_insn_data(qemu_plugin_tb_get_insn(block, k)))]++;
    for (int kind = 0; kind < KINDS; kind++)
        if (held[kind])
            qemu_plugin_register_vcpu_tb_exec_inline(block, 0, &counts[kind], held[kind]);
}

static void ended(uint64_t id, void *data)
{
    fprintf(stderr, "counted");
    for (int kind = 0; kind < KINDS; kind++)
        fprintf(stderr, " %" PRIu64, counts[kind]);
    fprintf(stderr, "\n");
}

__attribute__((visibility("default"))) int qemu_plugin_install(uint64_t id, const void *info, int argc, char **argv)
{
    qemu_plugin_register_vcpu_tb_trans_cb(id, translated);
    qemu_plugin_register_atexit_cb(id, ended, NULL);
    return 0;
}
