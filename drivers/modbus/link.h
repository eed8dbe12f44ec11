/* Describes a Modbus line by the options of a device. Any thread may call these functions. */
#pragma once

#include "drivers/device.h"

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

/* Returns whether two links that name the same line open it with the same settings. */
gboolean modbus_link_is_same(const struct modbus_link *a, const struct modbus_link *b);
