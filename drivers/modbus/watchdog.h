/*
 * The communication watchdog of a board or drive. The device switches off or stops by itself when
 * it gets no request for a while. Either it has a register with the timeout, or each relay is
 * switched on for a limited time only. Regular requests from the main loop keep the device on. The
 * device therefore switches off when this program dies, when its main loop hangs, and when the
 * cable is cut.
 */
#pragma once

#include "bus.h"

/* The options of a watchdog. */
struct modbus_watchdog {
    int address; /* address of the register; −1 if there is none */
    double after_s, scale;
};

/* The entries of a driver's option table for a watchdog. at is the offset of the struct
 * modbus_watchdog in the private struct of the driver. */
/* clang-format off */
#define MODBUS_WATCHDOG(at, field) ((at) + G_STRUCT_OFFSET(struct modbus_watchdog, field))
#define MODBUS_WATCHDOG_OPTIONS(at)                                                                \
    {"watchdog_register", OPTION_INT, NULL, -1, 65535, "-1", NULL, MODBUS_WATCHDOG(at, address),   \
     "Holding register of the communication timeout, after which the device switches off or "      \
     "stops by itself; −1: none is used"},                                                         \
    {"watchdog_after_s", OPTION_DOUBLE, "s", 0.1, 600, "3", NULL, MODBUS_WATCHDOG(at, after_s),    \
     "The communication timeout; the device is polled three times within it"},                     \
    {"watchdog_scale", OPTION_DOUBLE, NULL, 1e-3, 1e6, "1", NULL, MODBUS_WATCHDOG(at, scale),      \
     "Value of watchdog_register for 1 s"}
/* clang-format on */

/* modbus_watchdog_value() returns the value that the register gets: after_s · scale, rounded.
 * modbus_watchdog_s() returns the time in seconds that this rounded value stands for. */
int modbus_watchdog_value(const struct modbus_watchdog *watchdog);
double modbus_watchdog_s(const struct modbus_watchdog *watchdog);

/* Returns the time between two requests that keep the device on: a third of the watchdog's time. */
gint64 modbus_watchdog_period_us(const struct modbus_watchdog *watchdog);

/* Adds a mistake if the watchdog's value, after_s · scale, is not between 1 and max after rounding.
 * max is the largest value that the register or the timed relays of the board can hold. Also adds a
 * mistake if the time that the rounded value stands for is less than 1.5 times the time that one
 * lost answer takes: timeout_ms + 2 late_ms of the link. */
void modbus_watchdog_check(const struct modbus_watchdog *watchdog, const struct modbus_link *link,
                           const struct config_section *section, int max, Mistakes *mistakes);

/* For a device's open(): sets the register, if there is one, and reads it back. A value that the
 * register already holds is not written, because many boards keep the register in memory that wears
 * out. */
gboolean modbus_watchdog_arm(const struct modbus_watchdog *watchdog, ModbusBus *bus,
                             const struct modbus_link *link, GError **error);

/* Adds a request that checks that the register still holds the value. Adds nothing if there is no
 * register. The caller makes sure that the job has space for one more request. */
void modbus_watchdog_add_check(const struct modbus_watchdog *watchdog, struct modbus_job *job);
