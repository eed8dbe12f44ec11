/*
 * A Modbus line, RTU or TCP, shared by all devices that name it. The calls of libmodbus block, so
 * each line has a thread. The thread carries out jobs in order and posts their results to the main
 * loop.
 *
 * "Off" and "stop" are urgent jobs. They go before all jobs that have not begun. A command that an
 * urgent job overtakes must not be carried out after it. The device that sends "off" or "stop"
 * therefore drops its own "on" or "move" with modbus_bus_skip() first. A poll that has begun is
 * interrupted when one of its attempts fails while an urgent job waits, and begins again later.
 *
 * An urgent job for a unit that has not answered its last job makes only one attempt, except in
 * modbus_bus_do(). The class of the device asks again, and other units of the line must not wait
 * for a unit that does not answer.
 *
 * RTU has no transaction id. After a time-out, a late reply looks like the reply to the next
 * request. After a time-out the line therefore discards everything until it has been silent for
 * late_ms. It then repeats the request, and accepts the answer only if no second answer follows
 * within another late_ms. A request may therefore be carried out twice, so only write values that
 * may be written twice (absolute targets, coils).
 *
 * If the answer to an earlier request arrives late, the device is alive but slow. The attempt in
 * which the line sees this answer is not counted as one of the "retries". The request is repeated,
 * but not after the deadline of the job.
 *
 * All functions belong to the main loop's thread. Errors are DEVICE_ERROR, and name the line, the
 * unit and the address.
 */
#pragma once

#include "request.h"

typedef struct ModbusBus ModbusBus;

#define MODBUS_MAX_REQUESTS 16

/* Requests that are carried out together, in order, up to the first that fails. */
struct modbus_job {
    struct modbus_request requests[MODBUS_MAX_REQUESTS];
    int n;
    int tag;          /* names the job in modbus_bus_skip(); 0 or more, chosen by the device */
    gboolean skipped; /* in the result: no request of the job was sent */
};

/* Called from the main loop, exactly once for each job that was not cancelled. error is NULL if the
 * whole job succeeded. */
typedef void (*ModbusFunc)(const struct modbus_job *job, const GError *error, gpointer data);

/* For a device's open(): opens the line, or returns the open line if its settings are the same. May
 * wait timeout_ms for a connection. Returns NULL with an error that names file and line:
 * - DEVICE_ERROR: the line cannot be opened, or another process has locked the line or the unit.
 * - CONFIG_ERROR: the settings differ from those of the open line, or the clock is virtual. */
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

/* Carries out a copy of the job. The job may take at most deadline_ms from its beginning. The time
 * in the queue does not count, and neither does time in which this program was suspended. Jobs of
 * the same kind keep their order. */
void modbus_bus_start(ModbusBus *bus, const struct modbus_link *link, const struct modbus_job *job,
                      enum modbus_turn turn, double deadline_ms, ModbusFunc func, gpointer data);

/* Ends the jobs with this data and tag that have not begun and are not urgent. They end as skipped,
 * with DEVICE_ERROR_BUSY. Their callbacks come from the main loop, before those of later jobs. A
 * tag of -1 means any tag. */
void modbus_bus_skip(ModbusBus *bus, gpointer data, int tag);

/* Carries out an urgent job and waits for its end. On success, *job holds the values that were
 * read. Only for open() and close() of a device. */
gboolean modbus_bus_do(ModbusBus *bus, const struct modbus_link *link, struct modbus_job *job,
                       double deadline_ms, GError **error);

/* Drops the jobs with this data. No callback is made any more, and jobs that have not begun are
 * skipped. */
void modbus_bus_cancel(ModbusBus *bus, gpointer data);

/* For tests: returns the counts of faults. A fault that a repetition has corrected is counted, but
 * no answer shows it. */
void modbus_bus_counts(ModbusBus *bus, struct modbus_counts *ret);
