/*
 * A lamp bank: lamps that are switched one by one, by a relay board or a driver board.
 *
 * The class makes sure that a lamp that should be off is off (lights.h). It repeats "off" until the
 * device has confirmed it. It does so after an "off" that failed or was not answered, and after an
 * "on" that failed or was not answered, because the device may have carried out that "on". These
 * repetitions are not reported to the listener.
 */
#pragma once

#include "device.h"

typedef struct LampBank LampBank;

/* Called when a switch has ended. index is -1 for lamps_all_off(), and after the driver has called
 * lamps_lost(). error is NULL, or says why the switch failed; it is valid during the call. at_us is
 * the time of the device's answer or of the failure. The warm-up counts from at_us. */
typedef void (*LampsFunc)(LampBank *bank, int index, gboolean on, gint64 at_us, const GError *error,
                          gpointer data);

struct lamps_driver {
    struct driver_info info;
    /* Connects, fills bank->n, bank->warm_up_s and bank->watchdog_s, and leaves all lamps off. */
    gboolean (*open)(LampBank *bank, GError **error);
    /* Switches all lamps off with a single attempt, waits for the answer, and then releases the
     * device. */
    void (*close)(LampBank *bank);
    /* Starts to switch a lamp. Index -1 stands for all lamps; `on` is then FALSE. The driver later
     * calls lamps_report() once. The report has an error if the device has not confirmed the new
     * state. If set() returns FALSE, the driver reports nothing.
     *
     * "Off" need not wait for other commands that have not been sent. If "off" overtakes an "on" of
     * the same lamp, that "on" must never be sent and ends with DEVICE_ERROR_BUSY. A driver does
     * not repeat an "off" that failed, because the class does. */
    gboolean (*set)(LampBank *bank, int index, gboolean on, GError **error);
};

struct LampBank {
    struct device device;
    const struct lamps_driver *driver;
    int n;
    double warm_up_s; /* time from switching on until the output is stable */
    /* The time after which the lamps go off by themselves when this program has died, hangs or has
     * lost the connection. open() fills it. It is 0 if the lamps stay on. */
    double watchdog_s;
    struct lamps_state *state;
};

LampBank *lamps_open(const struct lamps_driver *driver, const struct config_section *section,
                     const char *const *also, Clock *clock, GError **error);

/* Switches all lamps off and closes the bank. NULL is ignored. */
void lamps_close(LampBank *bank);
G_DEFINE_AUTOPTR_CLEANUP_FUNC(LampBank, lamps_close)

void lamps_listen(LampBank *bank, LampsFunc func, gpointer data);

/* Switches a lamp. Several switches may be under way at the same time. Each ends in one event, and
 * the events of one lamp come in order. "Off" may overtake an "on" that has not been sent, which
 * then ends with DEVICE_ERROR_BUSY. "On" needs a permit (device_set_permit()). */
gboolean lamps_set(LampBank *bank, int index, gboolean on, GError **error);
gboolean lamps_all_off(LampBank *bank, GError **error);

enum light lamps_light(const LampBank *bank, int index);
/* Returns whether there may be light: the state is not LIGHT_OFF. */
gboolean lamps_is_on(const LampBank *bank, int index);
enum device_safety lamps_safety(const LampBank *bank); /* the state of all lamps together */

/* For drivers: answers each set() once. The set() calls for one lamp are answered in order. An
 * answer that comes after the deadline of the class still counts. Takes ownership of error. */
void lamps_report(LampBank *bank, int index, gboolean on, GError *error);

/* For drivers: reports that lamps have gone off by themselves, or that their state is unknown. The
 * listener gets a failed "on" of all lamps (index -1). The class then switches all lamps off, which
 * is reported as well. Call it last, because the listener may close the bank. Takes ownership of
 * error. */
void lamps_lost(LampBank *bank, GError *error);
