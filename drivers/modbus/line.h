/*
 * The blocking half of a Modbus line. It has one connection, recovers it after faults, and makes
 * one request at a time. All functions belong to the line's thread.
 */
#pragma once

#include "request.h"

struct modbus_line;

/* Copies the link. Does not connect. */
struct modbus_line *modbus_line_new(const struct modbus_link *link, GError **error);
void modbus_line_free(struct modbus_line *line); /* NULL is ignored */

/* Connects if the line is not connected. After a failure, unless the effort is MODBUS_ONCE, the
 * function first waits for the back-off time, but not beyond deadline_us (time of
 * g_get_monotonic_time()). */
gboolean modbus_line_connect(struct modbus_line *line, gint64 deadline_us, GError **error);

/* Makes one request, with retries, resynchronisation and read-back. */
gboolean modbus_line_do(struct modbus_line *line, int unit, struct modbus_request *request,
                        gint64 deadline_us, GError **error);

/* How modbus_line_do() repeats the next requests. */
enum modbus_effort {
    MODBUS_REPEAT, /* repeats as often as the link says, until the deadline */
    /* Makes one attempt without waiting for the back-off time, because the caller will ask again.
     */
    MODBUS_ONCE,
    /* Repeats like MODBUS_REPEAT, but not after an attempt that fails while *waiting is not 0. */
    MODBUS_YIELD,
};
/* Sets how requests are repeated. waiting is an atomic integer for MODBUS_YIELD, and NULL for the
 * others. */
void modbus_line_set_effort(struct modbus_line *line, enum modbus_effort effort,
                            const gint *waiting);

void modbus_line_counts(const struct modbus_line *line, struct modbus_counts *ret);
