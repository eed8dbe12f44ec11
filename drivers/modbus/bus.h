/*
 * A Modbus line, RTU or TCP, shared by all devices that name it. libmodbus blocks, so each line has
 * a thread of its own; it takes jobs in order and posts their results to the main loop.
 *
 * "Off" and "stop" are urgent jobs: they go before all jobs that have not begun. What they overtake
 * must not be carried out after them: the device that sends them drops its own "on" or "move" with
 * modbus_bus_skip() first. A poll that has begun gives way when one of its tries fails, and is
 * begun again later. An urgent job for a unit that has not answered its last job makes one attempt
 * only, since its class asks again, and other units of the line must not wait for it.
 *
 * RTU has no transaction id: after a time-out, a late reply looks like the reply to the next
 * request. So after a time-out the line discards everything until it has been silent for late_ms,
 * repeats the request, and accepts its answer only if no second answer follows within another
 * late_ms. A request may therefore be carried out twice: write only what may be written twice
 * (absolute targets, coils). An attempt that is followed by such a late answer does not count as
 * one of the request's "retries", because the device is alive; the deadline of the job ends the
 * attempts.
 *
 * All functions belong to the main loop's thread. Errors are DEVICE_ERROR, and name the line, the
 * unit and the address.
 */
#pragma once

#include "drivers/device.h"

typedef struct ModbusBus ModbusBus;

/* The options of a line in a device's section; the first member of the driver's struct. */
struct modbus_link {
    char *bus;
    int baud, parity, stop_bits; /* parity: index into modbus_parities */
    int unit;
    double timeout_ms, late_ms;
    int retries;
};

extern const char *const modbus_parities[];

/* The entries of an options table for a struct that begins with a struct modbus_link. */
#define MODBUS_LINK(name) G_STRUCT_OFFSET(struct modbus_link, name)
/* clang-format off */
#define MODBUS_LINK_OPTIONS                                                                        \
    {"bus", OPTION_STRING, .offset = MODBUS_LINK(bus),                                             \
     .help = "The line: /dev/ttyUSB0 or another serial port, or tcp:HOST:PORT"},                   \
    {"baud", OPTION_INT, NULL, 300, 4000000, "115200", NULL, MODBUS_LINK(baud),                    \
     "Serial: speed of the line"},                                                                 \
    {"parity", OPTION_CHOICE, NULL, 0, 0, "even", modbus_parities, MODBUS_LINK(parity),            \
     "Serial: parity of the line"},                                                                \
    {"stop_bits", OPTION_INT, NULL, 1, 2, "1", NULL, MODBUS_LINK(stop_bits),                       \
     "Serial: stop bits"},                                                                         \
    {"unit", OPTION_INT, NULL, 1, 247, "1", NULL, MODBUS_LINK(unit),                               \
     "The device's address on the line"},                                                          \
    {"timeout_ms", OPTION_DOUBLE, "ms", 1, 1000, "100", NULL, MODBUS_LINK(timeout_ms),             \
     "How long an answer may take; the same for all devices of a line"},                           \
    {"late_ms", OPTION_DOUBLE, "ms", 1, 5000, "300", NULL, MODBUS_LINK(late_ms),                   \
     "After a time-out: how late the answer may still come; the same for a line"},                 \
    {"retries", OPTION_INT, NULL, 0, 20, "3", NULL, MODBUS_LINK(retries),                          \
     "How often a request is repeated that got a damaged answer or none"}
/* clang-format on */

/* For a driver's check(): the sections above in the file that name the same line must open it with
 * the same settings. */
void modbus_link_check(const struct modbus_link *link, const struct config_section *section,
                       Mistakes *mistakes);

enum modbus_kind {
    MODBUS_READ_COILS,
    MODBUS_READ_INPUTS,
    MODBUS_READ_HOLDING,
    MODBUS_READ_INPUT_REGISTERS,
    MODBUS_WRITE_COILS,   /* function 5 for one, 15 for more */
    MODBUS_WRITE_HOLDING, /* function 6 for one, 16 for more */
    MODBUS_PULSE_COIL,    /* function 5 with a time instead of on or off; one at a time */
};

#define MODBUS_MAX_VALUES   64
#define MODBUS_MAX_REQUESTS 16

struct modbus_request {
    enum modbus_kind kind;
    int address, n;
    guint16 values[MODBUS_MAX_VALUES]; /* to write, or as read; bits are 0 or 1 */
    gboolean verify; /* write: reads back and compares; read: compares with values as they are */
    int coil;        /* MODBUS_PULSE_COIL: the coil that is on for that time; needed by verify */
};

/* Requests that are carried out together, in order, up to the first that fails. */
struct modbus_job {
    struct modbus_request requests[MODBUS_MAX_REQUESTS];
    int n;
    int tag;          /* the device's own, for modbus_bus_skip(); 0 or more */
    gboolean skipped; /* in the result: nothing of it was sent */
};

/* Called from the main loop, exactly once per job unless it was cancelled. error NULL: the whole
 * job succeeded. */
typedef void (*ModbusFunc)(const struct modbus_job *job, const GError *error, gpointer data);

/* Counts of a line since it was opened. */
struct modbus_counts {
    int transactions, timeouts, damaged, disbelieved, reconnects;
};

/* For a device's open(): opens the line, or shares the open one if its settings are the same. May
 * wait timeout_ms for a connection. Errors name file and line. */
ModbusBus *modbus_bus_get(const struct modbus_link *link, const struct device *device,
                          GError **error);
void modbus_bus_unref(ModbusBus *bus); /* NULL is ignored */

/* Adds a request; the caller makes sure that the job has room. */
struct modbus_request *modbus_job_add(struct modbus_job *job, enum modbus_kind kind, int address,
                                      int n);

enum modbus_turn {
    MODBUS_COMMAND,
    MODBUS_POLL,   /* waits until no other job is left */
    MODBUS_URGENT, /* goes before all others */
};

/* Carries out a copy of the job, for at most deadline_ms after its turn has come; waiting for other
 * jobs does not count. Jobs of the same kind keep their order. */
void modbus_bus_start(ModbusBus *bus, const struct modbus_link *link, const struct modbus_job *job,
                      enum modbus_turn turn, double deadline_ms, ModbusFunc func, gpointer data);

/* Ends the jobs of this data and tag that have not begun and are not urgent, as skipped, with
 * DEVICE_ERROR_BUSY. Their callbacks come from the main loop, before those of later jobs. tag -1:
 * any. */
void modbus_bus_skip(ModbusBus *bus, gpointer data, int tag);

/* Carries out an urgent job and waits for the end; only for open() and close() of a device. */
gboolean modbus_bus_do(ModbusBus *bus, const struct modbus_link *link, struct modbus_job *job,
                       double deadline_ms, GError **error);

/* Drops the jobs of this data: no callback is made any more, and jobs not yet begun are skipped. */
void modbus_bus_cancel(ModbusBus *bus, gpointer data);

void modbus_bus_counts(ModbusBus *bus, struct modbus_counts *ret);
