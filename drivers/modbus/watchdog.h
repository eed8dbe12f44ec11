/*
 * The end that a board or drive makes by itself when it is not heard of for a while: by its
 * register of a communication timeout, or because each relay is only ever switched on for a time.
 * What is on is kept on by asking anew, from the main loop: so it goes off when this program dies,
 * when its main loop hangs and when the cable is cut.
 */
#pragma once

#include "bus.h"

/* What a section says of it. */
struct modbus_watchdog {
    int address; /* of the register; −1: none */
    double after_s, scale;
};

/* The entries of an options table for a struct that has a struct modbus_watchdog at an offset. */
#define MODBUS_WATCHDOG_OPTIONS(at)                                                                \
    {"watchdog_register",                                                                          \
     OPTION_INT,                                                                                   \
     NULL,                                                                                         \
     -1,                                                                                           \
     65535,                                                                                        \
     "-1",                                                                                         \
     NULL,                                                                                         \
     (at) + G_STRUCT_OFFSET(struct modbus_watchdog, address),                                      \
     "Holding register of its communication timeout, after which it ends by itself what it does; " \
     "−1: none is used"},                                                                          \
        {"watchdog_after_s",                                                                       \
         OPTION_DOUBLE,                                                                            \
         "s",                                                                                      \
         0.1,                                                                                      \
         600,                                                                                      \
         "3",                                                                                      \
         NULL,                                                                                     \
         (at) + G_STRUCT_OFFSET(struct modbus_watchdog, after_s),                                  \
         "How long it hears nothing before it does so; it is asked three times as often"},         \
    {                                                                                              \
        "watchdog_scale", OPTION_DOUBLE, NULL, 1e-3, 1e6, "1", NULL,                               \
            (at) + G_STRUCT_OFFSET(struct modbus_watchdog, scale), "What is written to it for 1 s" \
    }

/* What is written, and the time that this is. */
int modbus_watchdog_value(const struct modbus_watchdog *watchdog);
double modbus_watchdog_s(const struct modbus_watchdog *watchdog);

/* How often what is on is to be asked for: three times as often as need be. */
gint64 modbus_watchdog_period_us(const struct modbus_watchdog *watchdog);

/* For a device's open(). Checks the time, whichever way the board keeps it; max: what fits. */
gboolean modbus_watchdog_check(const struct modbus_watchdog *watchdog,
                               const struct modbus_link *link, const struct device *device, int max,
                               GError **error);

/* For a device's open(): sets the register, if there is one, unless it holds the value already,
 * since many boards keep it in memory that wears; reads it back. */
gboolean modbus_watchdog_arm(const struct modbus_watchdog *watchdog, ModbusBus *bus,
                             const struct modbus_link *link, GError **error);

/* Adds the check that the register still holds it; the caller sees to it that there is room. */
void modbus_watchdog_add_check(const struct modbus_watchdog *watchdog, struct modbus_job *job);
