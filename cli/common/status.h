/* Parts of the text of “mesorig status”, made from a daemon's properties. */
#pragma once

#include "record.h"
#include "rig1-bus.h"

/* Returns whether a session is under way or paused. */
gboolean status_is_capturing(BusRig1 *rig);

/* Adds session, shots, frames, use of the disk, elapsed time, time left and predicted end of a
 * capture. The capture must have shots. */
void status_say_progress(Record *to, BusRig1 *rig);

/* Adds a text to the output, with a line for each of its sentences. The first line begins with key,
 * and the others are indented. */
void status_say_sentences(Record *to, const char *key, const char *text);

/* Adds a table with the health of each device in a few words. Below the table are the texts of all
 * faults and of all devices that are not safe. A text that occurs several times is added once. A
 * text that the string `reason` contains is left out. `reason` must not be NULL. `devices` is
 * "a(ssss)", the property Devices.
 *
 * While a device has a fault, the "ok" of another device is shown as "ok before the fault", because
 * the answer of that device may be older than the fault. */
void status_say_devices(Record *to, GVariant *devices, const char *reason);
