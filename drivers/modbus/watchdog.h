/*
 * The communication watchdog of a board or drive: it switches off or stops by itself when it gets
 * no request for a while. Either it has a register with the timeout, or each relay is switched on
 * for a limited time only. Regular requests from the main loop keep the device on. It therefore
 * switches off when this program dies, when its main loop hangs and when the cable is cut.
 */
#pragma once

#include "bus.h"

/* The options of a watchdog. */
struct modbus_watchdog {
    int address; /* of the register; −1: none */
    double after_s, scale;
};

/* The entries of an options table for a struct that has a struct modbus_watchdog at an offset. */
/* clang-format off */
#define MODBUS_WATCHDOG(at, field) ((at) + G_STRUCT_OFFSET(struct modbus_watchdog, field))
#define MODBUS_WATCHDOG_OPTIONS(at)                                                                \
    {"watchdog_register", OPTION_INT, NULL, -1, 65535, "-1", NULL, MODBUS_WATCHDOG(at, address),   \
     "Holding register of the communication timeout, after which the device switches off or "     \
     "stops by itself; −1: none is used"},                                                         \
    {"watchdog_after_s", OPTION_DOUBLE, "s", 0.1, 600, "3", NULL, MODBUS_WATCHDOG(at, after_s),    \
     "The communication timeout; the device is polled three times within it"},                     \
    {"watchdog_scale", OPTION_DOUBLE, NULL, 1e-3, 1e6, "1", NULL, MODBUS_WATCHDOG(at, scale),      \
     "Value of watchdog_register for 1 s"}
/* clang-format on */

/* The value for its register, and the time that this value stands for. */
int modbus_watchdog_value(const struct modbus_watchdog *watchdog);
double modbus_watchdog_s(const struct modbus_watchdog *watchdog);

/* Time between two feedings: a third of the watchdog's time. */
gint64 modbus_watchdog_period_us(const struct modbus_watchdog *watchdog);

/* For a driver's check(): checks the watchdog's time, in either form; max: the largest value that
 * the board can hold. */
void modbus_watchdog_check(const struct modbus_watchdog *watchdog, const struct modbus_link *link,
                           const struct config_section *section, int max, Mistakes *mistakes);

/* For a device's open(): sets the register, if there is one, and reads it back. Does not write a
 * value that the register already holds, since many boards keep it in memory that wears. */
gboolean modbus_watchdog_arm(const struct modbus_watchdog *watchdog, ModbusBus *bus,
                             const struct modbus_link *link, GError **error);

/* Adds a request that checks that the register still holds the value; the caller sees to it that
 * the job has room. */
void modbus_watchdog_add_check(const struct modbus_watchdog *watchdog, struct modbus_job *job);
