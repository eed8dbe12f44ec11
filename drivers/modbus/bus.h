/*
 * A Modbus line, RTU or TCP, shared by all devices that name it. The calls of libmodbus block, so
 * each line has a thread. The thread carries out jobs in order and posts their results to the main
 * loop.
 *
 * "Off" and "stop" are urgent jobs. They go before all jobs that have not begun. A command that an
 * urgent job overtakes must not be carried out after it: the device that sends "off" or "stop"
 * drops its own "on" or "move" with modbus_bus_skip() first. A poll that has begun is interrupted
 * when one of its attempts fails, and begins again later. An urgent job for a unit that has not
 * answered its last job makes only one attempt. Its class asks again, and other units of the line
 * must not wait for it.
 *
 * RTU has no transaction id. After a time-out, a late reply looks like the reply to the next
 * request. After a time-out the line therefore discards everything until it has been silent for
 * late_ms. It then repeats the request, and accepts the answer only if no second answer follows
 * within another late_ms. A request may therefore be carried out twice, so only write values that
 * may be written twice (absolute targets, coils). An attempt that is followed by such a late answer
 * does not count as one of the request's "retries", because the device is alive. These attempts end
 * at the deadline of the job.
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
     "How late an answer may come after a time-out; the same for all devices of a line"},          \
    {"retries", OPTION_INT, NULL, 0, 20, "3", NULL, MODBUS_LINK(retries),                          \
     "How often a request is repeated after a damaged answer or none"}
/* clang-format on */

/* For a driver's check(): adds a mistake if a section further up in the file names the same line
 * with other settings. */
void modbus_link_check(const struct modbus_link *link, const struct config_section *section,
                       Mistakes *mistakes);

enum modbus_kind {
    MODBUS_READ_COILS,
    MODBUS_READ_INPUTS,
    MODBUS_READ_HOLDING,
    MODBUS_READ_INPUT_REGISTERS,
    MODBUS_WRITE_COILS,   /* function 5 for one value, function 15 for more */
    MODBUS_WRITE_HOLDING, /* function 6 for one value, function 16 for more */
    MODBUS_PULSE_COIL,    /* function 5 with a time instead of on or off; one coil at a time */
};

#define MODBUS_MAX_VALUES   64
#define MODBUS_MAX_REQUESTS 16

struct modbus_request {
    enum modbus_kind kind;
    int address, n;
    /* Values to write, or values that were read; bits are 0 or 1. */
    guint16 values[MODBUS_MAX_VALUES];
    /* After a write, the values are read back and compared. For a read, the values that were read
     * are compared with the given values. */
    gboolean verify;
    /* MODBUS_PULSE_COIL: the coil that is on for that time; verify needs it */
    int coil;
};

/* Requests that are carried out together, in order, up to the first that fails. */
struct modbus_job {
    struct modbus_request requests[MODBUS_MAX_REQUESTS];
    int n;
    int tag;          /* number that the device chooses for modbus_bus_skip(); 0 or more */
    gboolean skipped; /* in the result: no request of the job was sent */
};

/* Called from the main loop, exactly once for each job that was not cancelled. error is NULL if the
 * whole job succeeded. */
typedef void (*ModbusFunc)(const struct modbus_job *job, const GError *error, gpointer data);

/* Counters of a line since it was opened. */
struct modbus_counts {
    int transactions, timeouts, damaged, disbelieved, reconnects;
};

/* For a device's open(): opens the line, or returns the open one if its settings are the same. May
 * wait timeout_ms for a connection. Errors name file and line. */
ModbusBus *modbus_bus_get(const struct modbus_link *link, const struct device *device,
                          GError **error);
void modbus_bus_unref(ModbusBus *bus); /* NULL is ignored */

/* Adds a request to a job. The caller makes sure that the job has room for it. */
struct modbus_request *modbus_job_add(struct modbus_job *job, enum modbus_kind kind, int address,
                                      int n);

enum modbus_turn {
    MODBUS_COMMAND,
    MODBUS_POLL,   /* begins when no other job is left */
    MODBUS_URGENT, /* begins before all other jobs */
};

/* Carries out a copy of the job. The job may take at most deadline_ms from its begin; the time in
 * the queue does not count. Jobs of the same kind keep their order. */
void modbus_bus_start(ModbusBus *bus, const struct modbus_link *link, const struct modbus_job *job,
                      enum modbus_turn turn, double deadline_ms, ModbusFunc func, gpointer data);

/* Ends the jobs with this data and tag that have not begun and are not urgent. They end as skipped,
 * with DEVICE_ERROR_BUSY. Their callbacks come from the main loop, before those of later jobs. A
 * tag of -1 means any tag. */
void modbus_bus_skip(ModbusBus *bus, gpointer data, int tag);

/* Carries out an urgent job and waits for its end. Only for open() and close() of a device. */
gboolean modbus_bus_do(ModbusBus *bus, const struct modbus_link *link, struct modbus_job *job,
                       double deadline_ms, GError **error);

/* Drops the jobs with this data. No callback is made any more, and jobs that have not begun are
 * skipped. */
void modbus_bus_cancel(ModbusBus *bus, gpointer data);

void modbus_bus_counts(ModbusBus *bus, struct modbus_counts *ret);
