/*
 * The blocking half of a Modbus line: it has one connection, recovers it after faults, and makes
 * one request at a time. Belongs to the line's thread.
 */
#pragma once

#include "bus.h"

struct modbus_line;

/* Copies the link. Does not connect. */
struct modbus_line *modbus_line_new(const struct modbus_link *link, GError **error);
void modbus_line_free(struct modbus_line *line); /* NULL is ignored */

/* Connects if the line is not connected; after a failure waits for the back-off first, but not
 * beyond deadline_us (of g_get_monotonic_time()). */
gboolean modbus_line_connect(struct modbus_line *line, gint64 deadline_us, GError **error);

/* One request, with retries, resynchronisation and read-back. */
gboolean modbus_line_do(struct modbus_line *line, int unit, struct modbus_request *request,
                        gint64 deadline_us, GError **error);

/* How the next requests of modbus_line_do() are repeated. */
enum modbus_effort {
    MODBUS_REPEAT, /* as the link says, until the deadline */
    MODBUS_ONCE,   /* one attempt, without waiting for the back-off: whoever asks will ask again */
    MODBUS_YIELD,  /* as MODBUS_REPEAT; a failed attempt is the last while *waiting is not 0 */
};
/* waiting: atomic; for MODBUS_YIELD, else NULL. */
void modbus_line_set_effort(struct modbus_line *line, enum modbus_effort effort,
                            const gint *waiting);

void modbus_line_counts(const struct modbus_line *line, struct modbus_counts *ret);
