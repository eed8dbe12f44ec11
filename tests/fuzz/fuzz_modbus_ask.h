/* A request on a Modbus line, as two bytes of an input choose it. */
#pragma once

#include "fuzz.h"
#include "modbus/line.h"

/* Returns FALSE if the line cannot be opened again. n may be negative. */
static inline gboolean fuzz_modbus_ask(struct modbus_line *line, int kind, int n, int address,
                                       gint64 deadline_us) {
    static const enum modbus_kind kinds[] = {
        MODBUS_READ_COILS,  MODBUS_READ_INPUTS,   MODBUS_READ_HOLDING, MODBUS_READ_INPUT_REGISTERS,
        MODBUS_WRITE_COILS, MODBUS_WRITE_HOLDING, MODBUS_PULSE_COIL};
    const enum modbus_kind is = kinds[kind % (int)G_N_ELEMENTS(kinds)];
    const gboolean bits = is == MODBUS_READ_COILS || is == MODBUS_READ_INPUTS;
    struct modbus_request request = {
        .kind = is,
        .address = address,
        .n = is == MODBUS_PULSE_COIL ? 1 : 1 + (n & 63) % MODBUS_MAX_VALUES,
        .verify = n >= 0 && (n & 64) && is != MODBUS_PULSE_COIL};
    GError *error = NULL;
    gboolean ok = modbus_line_connect(line, deadline_us, &error);
    fuzz_check(ok, &error);
    if (!ok)
        return FALSE;
    ok = modbus_line_do(line, 1, &request, deadline_us, &error);
    fuzz_check(ok, &error);
    for (int k = 0; ok && bits && k < request.n; k++)
        g_assert_cmpint(request.values[k], <=, 1);
    return TRUE;
}
