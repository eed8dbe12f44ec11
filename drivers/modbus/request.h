/* A request to a unit of a Modbus line, and the fault counters of a line. Plain data. */
#pragma once

#include "link.h"

enum modbus_kind {
    MODBUS_READ_COILS,
    MODBUS_READ_INPUTS,
    MODBUS_READ_HOLDING,
    MODBUS_READ_INPUT_REGISTERS,
    MODBUS_WRITE_COILS,   /* function 5 for one value, function 15 for more */
    MODBUS_WRITE_HOLDING, /* function 6 for one value, function 16 for more */
    MODBUS_PULSE_COIL,    /* function 5 with a time instead of on or off; one coil at a time */
};

#define MODBUS_MAX_VALUES 64

struct modbus_request {
    enum modbus_kind kind;
    int address, n;
    /* Values to write, or values that were read; bits are 0 or 1. */
    guint16 values[MODBUS_MAX_VALUES];
    /* After a write, the values are read back and compared. For a read, the values that were read
     * are compared with the given values. */
    gboolean verify;
    /* For MODBUS_PULSE_COIL with verify: the address of the coil that is on during the pulse. */
    int coil;
};

/* Numbers of faults on a line since it was opened:
 * - timeouts: requests without an answer in time
 * - damaged: damaged answers
 * - disbelieved: answers that were not used, because another answer followed */
struct modbus_counts {
    int timeouts, damaged, disbelieved;
};
