/* Devices of all classes on one virtual Modbus device, and what they say, in real time. */
#pragma once

#include "modbus_rig.h"

struct bench {
    VirtualModbus *device;
    Clock *clock;
    Config *config; /* of the section opened last */
    Axis *axis;
    LampBank *bank;
    Laser *laser;
    Interlock *door;
    int n;     /* events not yet expected */
    int event; /* the last one: of an axis, or on */
    GError *error;
    gint64 at_us;
};

/* The fixture of a test: the virtual device, over TCP unless rtu. */
void bench_begin(struct bench *bench, gconstpointer rtu);
void bench_end(struct bench *bench, gconstpointer unused);

/* A section of the device, of the file /rig/rig.conf; valid until the next one. */
const struct config_section *bench_section(struct bench *bench, const char *header,
                                           const char *keys);

void bench_open_axis(struct bench *bench, const char *keys); /* next to RIG_AXIS */
void bench_open_bank(struct bench *bench, const char *keys);
void bench_open_laser(struct bench *bench, const char *keys);
void bench_open_door(struct bench *bench, const char *keys);
void bench_on_laser(Laser *laser, gboolean on, const GError *error, gpointer bench);

/* Faults from now on, as in bench_fail (bench, .silent = 1); none: bench_fail (bench, 0). */
#define bench_fail(bench, ...)                                                                     \
    virtual_modbus_fail((bench)->device, &(struct virtual_modbus_faults){__VA_ARGS__})
struct virtual_modbus_state bench_state(struct bench *bench);

/* Waits for the one event. */
void bench_expect(struct bench *bench, int event);
void bench_expect_error(struct bench *bench, enum device_error code, const char *words);
/* Waits until the axis moves and the device has been asked again: its command has been answered
 * then, for a line asks one thing at a time. */
void bench_started(struct bench *bench);
void bench_home(struct bench *bench);

/* Waits until every device that should be off or stand has confirmed it; returns how long, in s. */
double bench_wait_safe(struct bench *bench);
