/*
 * A line laser's power switch. Its sweep is an Axis. Never on with the interlock open.
 *
 * A laser that should be off is sent "off" until the device has confirmed it (lights.h): after an
 * "off" that failed or was not answered, and after an "on" that failed or was not answered, which
 * the device may have carried out. These repetitions are not reported to the listener.
 */
#pragma once

#include "device.h"
#include "interlock.h"

typedef struct Laser Laser;

typedef void (*LaserFunc)(Laser *laser, gboolean on, const GError *error, gpointer data);

struct laser_driver {
    struct driver_info info;
    gboolean (*open)(Laser *laser, GError **error); /* leaves it off; fills warm_up_s */
    void (*close)(Laser *laser); /* switches it off, waiting for it and trying once */
    /* As set() of struct lamps_driver; ended by laser_report(). */
    gboolean (*set)(Laser *laser, gboolean on, GError **error);
    gboolean simulated; /* emits no real light, and ends with this program */
    /* Optional, for simulated units: the unit has been mounted at another place, given by the name
     * of its section in the rig file. FALSE if there is no such place. */
    gboolean (*mount)(Laser *laser, const char *place, GError **error);
};

struct Laser {
    struct device device;
    const struct laser_driver *driver;
    double warm_up_s;
    double watchdog_s; /* filled by open(): how long after this program died, hung or lost the
                        * connection it goes off by itself; 0: it stays on */
    struct laser_state *state;
};

Laser *laser_open(const struct laser_driver *driver, const struct config_section *section,
                  const char *const *also, Clock *clock, GError **error);
void laser_close(Laser *laser); /* off first; NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Laser, laser_close)

void laser_listen(Laser *laser, LaserFunc func, gpointer data);

/* The interlock that guards it (not owned, must live longer), or NULL for none. When it opens the
 * laser is switched off at once, whether or not anything listens. */
void laser_guard(Laser *laser, Interlock *interlock);

/* Always accepts off; refuses on with DEVICE_ERROR_INTERLOCK while the interlock is open, and
 * without a permit (device_set_permit()). */
gboolean laser_set(Laser *laser, gboolean on, GError **error);
enum light laser_light(const Laser *laser);
gboolean laser_is_on(const Laser *laser); /* it may shine: not LIGHT_OFF */
enum device_safety laser_safety(const Laser *laser);

/* Says that somebody has mounted the unit at the place of that section of the rig file. */
gboolean laser_mount(Laser *laser, const char *place, GError **error);

/* For drivers, as lamps_report(). Takes ownership of error. */
void laser_report(Laser *laser, gboolean on, GError *error);

/* For drivers: the laser has gone off by itself, or its state is unknown. Reports a failed "on" and
 * switches it off, which is reported as well. Call it last: the listener may close the laser. Takes
 * ownership of error. */
void laser_lost(Laser *laser, GError *error);
