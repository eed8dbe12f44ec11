/*
 * The rig that is open, and who uses it. The struct is owned by the Bus, and the parts of the Bus
 * borrow it. bus.c opens and closes the rig. All parts may read the members and call the functions.
 * If another part than bus.c sets a member, the comment of the member says so. All functions belong
 * to the main loop's thread.
 */
#pragma once

#include "rig/devices.h"
#include "rig/guardian.h"
#include "rig1-bus.h"

struct bus_latch;

struct bus_rig {
    BusRig1 *object;         /* shows the rig to clients; borrowed */
    struct bus_latch *latch; /* latch of the safe state (bus_latch.h); borrowed */
    struct devices *devices; /* NULL if no rig is open */
    char *path;
    Guardian *guardian; /* NULL if all devices are simulated */
    /* the rig is being made safe before it is closed, and no operation may begin */
    gboolean ending;
    /* The rig has been made safe, and every device has confirmed this (DEVICE_SAFE). Each part that
     * switches on or moves a device sets this member to FALSE. */
    gboolean is_safe;
    gboolean holds_clock;
    const char *captured; /* session directory of the capture under way (bus_run.h), or NULL */
    guint n_hands;        /* number of devices in use by hand (bus_hands.h) */
    GHashTable *faults;   /* maps the name of a device to a message */
    /* Maps a device ("laser top") to the state that it has not confirmed (bus_safety.h). */
    GHashTable *unsafe;
    /* Called when a device has become free or has confirmed that it is safe, because the queue of
     * sessions may be waiting for that. */
    void (*freed)(gpointer data);
    gpointer data;
};

void bus_rig_init(struct bus_rig *rig, BusRig1 *object);
void bus_rig_clear(struct bus_rig *rig);

/* Returns whether a rig is open and is not being closed. The error is BUS_ERROR_NO_RIG if no rig is
 * open, and BUS_ERROR_BUSY if it is being closed. */
gboolean bus_rig_need_open(const struct bus_rig *rig, GError **error);

/* Returns an interlock that is open, or NULL. A rig must be open. */
const Interlock *bus_rig_open_interlock(const struct bus_rig *rig);

/* Sends an event to all clients and the log. If level is "error", message also becomes the fault of
 * the device whose name is `source`. */
void bus_rig_report(struct bus_rig *rig, const char *level, const char *source,
                    const char *message);
/* Sets the property Devices to the present state of the devices. */
void bus_rig_show_devices(struct bus_rig *rig);

/* Sends the changed properties to the clients. Call it before a method is answered, so that the
 * client does not read an old state after the answer. */
void bus_rig_flush(const struct bus_rig *rig);

/* If hold is TRUE, stops the clock of a simulated rig, so that its time stands still until a client
 * requests something. If hold is FALSE, lets the clock run. A simulated rig may have faults that
 * occur after some seconds. If its clock were never stopped, such a fault could occur before the
 * first call. */
void bus_rig_hold_clock(struct bus_rig *rig, gboolean hold);
