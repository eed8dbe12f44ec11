/*
 * A lamp bank: lamps that are switched one by one, by relay or by a driver board.
 *
 * A lamp that should be off is sent "off" until the device has confirmed it (lights.h): after an
 * "off" that failed or was not answered, and after an "on" that failed or was not answered, which
 * the device may have carried out. These repetitions are not reported to the listener.
 */
#pragma once

#include "device.h"

typedef struct LampBank LampBank;

/* index is -1 for all_off, and for lamps that were lost. error: NULL, or why the switch failed;
 * valid during the call. at_us: when the switch took effect, from which the warm-up counts. */
typedef void (*LampsFunc)(LampBank *bank, int index, gboolean on, gint64 at_us, const GError *error,
                          gpointer data);

struct lamps_driver {
    struct driver_info info;
    /* Connects and fills bank->n and bank->warm_up_s; leaves all lamps off. */
    gboolean (*open)(LampBank *bank, GError **error);
    /* Switches all lamps off, waiting for it and trying once, then releases the device. */
    void (*close)(LampBank *bank);
    /* Starts to switch; the driver then calls lamps_report() once, with an error unless the device
     * has confirmed the new state. Index -1 with on FALSE: all lamps. FALSE: nothing is reported.
     * "Off" need not wait for other commands that have not been sent; an "on" of the same lamp must
     * then never be sent, and ends with DEVICE_ERROR_BUSY. A driver does not repeat an "off" that
     * failed; the class does. */
    gboolean (*set)(LampBank *bank, int index, gboolean on, GError **error);
};

struct LampBank {
    struct device device;
    const struct lamps_driver *driver;
    int n;
    double warm_up_s;  /* from switching on until the output is stable */
    double watchdog_s; /* filled by open(): how long after this program died, hung or lost the
                        * connection its lamps go off by themselves; 0: they stay on */
    struct lamps_state *state;
};

LampBank *lamps_open(const struct lamps_driver *driver, const struct config_section *section,
                     const char *const *also, Clock *clock, GError **error);

/* Switches all lamps off and closes the bank. NULL is ignored. */
void lamps_close(LampBank *bank);
G_DEFINE_AUTOPTR_CLEANUP_FUNC(LampBank, lamps_close)

void lamps_listen(LampBank *bank, LampsFunc func, gpointer data);

/* Several switches may be under way at once; each ends in its own event, those of one lamp in
 * order. "Off" may overtake an "on" that has not been sent, which then ends with DEVICE_ERROR_BUSY.
 * "On" needs a permit (device_set_permit()). */
gboolean lamps_set(LampBank *bank, int index, gboolean on, GError **error);
gboolean lamps_all_off(LampBank *bank, GError **error);

enum light lamps_light(const LampBank *bank, int index);
gboolean lamps_is_on(const LampBank *bank, int index); /* there may be light: not LIGHT_OFF */
enum device_safety lamps_safety(const LampBank *bank); /* of all its lamps */

/* Since when the device has confirmed that the lamp is on; -1: it has not. */
gint64 lamps_on_since_us(const LampBank *bank, int index);

/* For drivers: answers each set() once; for one lamp, in order. An answer after the deadline of the
 * class counts as well. Takes ownership of error. */
void lamps_report(LampBank *bank, int index, gboolean on, GError *error);

/* For drivers: lamps have gone off by themselves, or their state is unknown. Reports a failed "on"
 * of all lamps (index -1) and switches all off, which is reported as well. Call it last: the
 * listener may close the bank. Takes ownership of error. */
void lamps_lost(LampBank *bank, GError *error);
