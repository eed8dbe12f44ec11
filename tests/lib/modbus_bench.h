/* Devices of all classes on one virtual Modbus device, and their events, in real time. */
#pragma once

#include "modbus_rig.h"

struct bench {
    VirtualModbus *device;
    Clock *clock;
    Config *config; /* the section that was opened last */
    Axis *axis;
    LampBank *bank;
    Laser *laser;
    Interlock *door;
    int n;     /* number of events since the last bench_expect() */
    int event; /* the last event: an axis event, or whether a device is on */
    GError *error;
    gint64 at_us;
};

/* Fixture of a test: the virtual device, on TCP, or on RTU if rtu is not NULL. */
void bench_begin(struct bench *bench, gconstpointer rtu);
void bench_end(struct bench *bench, gconstpointer unused);

/* Returns a section for the device, in the file /rig/rig.conf. It is valid until the next call. */
const struct config_section *bench_section(struct bench *bench, const char *header,
                                           const char *keys);

void bench_open_axis(struct bench *bench, const char *keys); /* keys are added to RIG_AXIS */
void bench_open_bank(struct bench *bench, const char *keys);
void bench_open_laser(struct bench *bench, const char *keys);
void bench_open_door(struct bench *bench, const char *keys);
void bench_on_laser(Laser *laser, gboolean on, const GError *error, gpointer bench);

/* Sets the faults from now on, for example bench_fail(bench, .silent = 1). bench_fail(bench, 0)
 * ends all faults. */
#define bench_fail(bench, ...)                                                                     \
    virtual_modbus_fail((bench)->device, &(struct virtual_modbus_faults){__VA_ARGS__})
struct virtual_modbus_state bench_state(struct bench *bench);

/* Waits for exactly one event. */
void bench_expect(struct bench *bench, int event);
void bench_expect_error(struct bench *bench, enum device_error code, const char *words);
/* Waits until the axis moves and two more requests have arrived. The command has then been
 * answered, because a line sends one request at a time. */
void bench_started(struct bench *bench);
void bench_home(struct bench *bench);

/* Waits until every device has confirmed that it is off or stands still. Returns the time that it
 * took, in seconds. */
double bench_wait_safe(struct bench *bench);
