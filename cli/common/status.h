/* Parts of the text of “mesorig status”, made from a daemon's properties. */
#pragma once

#include "record.h"
#include "rig1-bus.h"

/* Returns whether a session is under way or paused. */
gboolean status_is_capturing(BusRig1 *rig);

/* Adds session, shots, frames, elapsed time and predicted end of a capture that has shots. */
void status_say_progress(Record *to, BusRig1 *rig);

/* Prints a line for each sentence, and indents those after the first. */
void status_say_sentences(Record *to, const char *key, const char *text);

/* Prints a table with the health of each device in a few words, followed by the texts of all faults
 * and of all devices that are not safe. A text is printed once, and not if reason contains it.
 * devices is "a(ssss)", the property Devices. While a device has a fault, "ok" is shown as "ok
 * before the fault", because it is the last answer of a device and may be older than the fault of
 * another device. */
void status_say_devices(Record *to, GVariant *devices, const char *reason);
