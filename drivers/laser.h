/*
 * The power switch of a line laser. The laser's sweep is an Axis. The class keeps the laser off
 * while the interlock is open.
 *
 * The class makes sure that a laser that should be off is off (lights.h). It repeats "off" until
 * the device has confirmed it. It does so after an "off" that failed or was not answered, and after
 * an "on" that failed or was not answered, because the device may have carried out that "on". These
 * repetitions are not reported to the listener.
 */
#pragma once

#include "device.h"
#include "interlock.h"

typedef struct Laser Laser;

/* Called when a switch of the laser has ended. error is NULL, or says why the switch failed; it is
 * valid during the call. */
typedef void (*LaserFunc)(Laser *laser, gboolean on, const GError *error, gpointer data);

struct laser_driver {
    struct driver_info info;
    /* Connects, leaves the laser off, and fills warm_up_s and watchdog_s. */
    gboolean (*open)(Laser *laser, GError **error);
    /* Switches the laser off with a single attempt, waits for the answer, and releases the
     * device. */
    void (*close)(Laser *laser);
    /* Starts to switch the laser, like set() of struct lamps_driver (lamps.h). The driver then
     * calls laser_report() once. */
    gboolean (*set)(Laser *laser, gboolean on, GError **error);
    gboolean simulated; /* the laser emits no real light and ends with this program */
    /* Optional, for simulated units: says that the unit has been mounted at another place. place is
     * the name of a section of the rig file. Returns FALSE if there is no such place. */
    gboolean (*mount)(Laser *laser, const char *place, GError **error);
};

struct Laser {
    struct device device;
    const struct laser_driver *driver;
    double warm_up_s; /* time from switching on until the output is stable */
    /* The time after which the laser goes off by itself when this program has died, hangs or has
     * lost the connection. open() fills it. It is 0 if the laser stays on. */
    double watchdog_s;
    struct laser_state *state;
};

Laser *laser_open(const struct laser_driver *driver, const struct config_section *section,
                  const char *const *also, Clock *clock, GError **error);
void laser_close(Laser *laser); /* switches the laser off first; NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Laser, laser_close)

void laser_listen(Laser *laser, LaserFunc func, gpointer data);

/* Sets the interlock that guards the laser, or NULL for none. The laser does not own the interlock,
 * which must live longer than the laser. When the interlock opens, the laser is switched off
 * immediately, even if no listener is set. */
void laser_guard(Laser *laser, Interlock *interlock);

/* Switches the laser. "Off" is always accepted. "On" fails with DEVICE_ERROR_INTERLOCK while the
 * interlock is open, and it needs a permit (device_set_permit()). */
gboolean laser_set(Laser *laser, gboolean on, GError **error);
enum light laser_light(const Laser *laser);
/* Returns whether the laser may shine: the state is not LIGHT_OFF. */
gboolean laser_is_on(const Laser *laser);
enum device_safety laser_safety(const Laser *laser);

/* Tells the driver that somebody has mounted the unit at the place that a section of the rig
 * file describes. place is the name of the section. Does nothing if the driver has no mount(). */
gboolean laser_mount(Laser *laser, const char *place, GError **error);

/* For drivers: answers set(), like lamps_report(). Takes ownership of error. */
void laser_report(Laser *laser, gboolean on, GError *error);

/* For drivers: reports that the laser has gone off by itself, or that its state is unknown. The
 * listener gets a failed "on". The class then switches the laser off, which is reported as well.
 * Call it last, because the listener may close the laser. Takes ownership of error. */
void laser_lost(Laser *laser, GError *error);
