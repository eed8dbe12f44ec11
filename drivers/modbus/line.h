/*
 * The blocking half of a Modbus line. It has one connection, recovers it after faults, and makes
 * one request at a time. All functions belong to the line's thread.
 */
#pragma once

#include "request.h"

struct modbus_line;

/* Copies the link. Does not connect. Returns NULL with DEVICE_ERROR_DISCONNECTED if link->bus is
 * not the name of a line. */
struct modbus_line *modbus_line_new(const struct modbus_link *link, GError **error);
void modbus_line_free(struct modbus_line *line); /* NULL is ignored */

/* Connects if the line is not connected. With MODBUS_ONCE, makes one attempt at once. Otherwise
 * repeats the attempt until deadline_us (time of g_get_monotonic_time()). The pauses between the
 * attempts grow from 50 ms to 1 s. If the next pause would end after deadline_us, the function
 * fails at once. If the line is serial and another program uses it, the error is DEVICE_ERROR_BUSY.
 * Otherwise it is DEVICE_ERROR_DISCONNECTED. */
gboolean modbus_line_connect(struct modbus_line *line, gint64 deadline_us, GError **error);

/* Makes one request, with retries, resynchronisation and, if request->verify is TRUE, read-back.
 * Connects if necessary. A read stores its values in request->values. Time in which this program
 * was suspended does not count, and a failed first attempt may be repeated although the deadline
 * has passed. The call may therefore end after deadline_us. The error is a DEVICE_ERROR. */
gboolean modbus_line_do(struct modbus_line *line, int unit, struct modbus_request *request,
                        gint64 deadline_us, GError **error);

/* How modbus_line_do() repeats the next requests. */
enum modbus_effort {
    MODBUS_REPEAT, /* the default: repeats as often as the link says, until the deadline */
    /* Makes one attempt without waiting for the back-off time, because the caller will ask again.
     * Only a unit that answers that it is busy is asked again. */
    MODBUS_ONCE,
    /* While *waiting is 0, repeats like MODBUS_REPEAT. While *waiting is not 0, only a unit that
     * answers that it is busy is asked again. */
    MODBUS_YIELD,
};
/* Sets how requests are repeated. For MODBUS_YIELD, waiting is an atomic integer. For the other
 * efforts it is NULL. */
void modbus_line_set_effort(struct modbus_line *line, enum modbus_effort effort,
                            const gint *waiting);

void modbus_line_counts(const struct modbus_line *line, struct modbus_counts *ret);
