/* Parts of what “mesorig status” says for people, of a daemon's properties. */
#pragma once

#include "record.h"
#include "rig1-bus.h"

/* A session is under way, if only paused. */
gboolean status_is_capturing(BusRig1 *rig);

/* Session, shots, frames, elapsed time and predicted end of a capture that has shots. */
void status_say_progress(Record *to, BusRig1 *rig);

/* Prints a line for each sentence, and indents those after the first. */
void status_say_sentences(Record *to, const char *key, const char *text);

/* devices: "a(ssss)", as the property Devices. Prints a table with one word for the health of each
 * device, and after it the text of each fault once, unless reason contains it. "ok" is what a
 * device last answered, which may have been before the fault of another device. */
void status_say_devices(Record *to, GVariant *devices, const char *reason);
