/* Parts of what “mesorig status” says for people, of a daemon's properties. */
#pragma once

#include "record.h"
#include "rig1-bus.h"

/* A session is under way, if only paused. */
gboolean status_is_capturing(BusRig1 *rig);

/* Session, shots, frames, elapsed time and predicted end of a capture that has shots. */
void status_say_progress(Record *to, BusRig1 *rig);

/* A line for each sentence; those behind the first are indented. */
void status_say_sentences(Record *to, const char *key, const char *text);

/* devices: "a(ssss)", as the property Devices. Its table has a word for each fault; behind it are
 * the faults themselves, once each, but not those that the reason tells. A device that is "ok" was
 * so when it last answered, which may have been before the fault of another. */
void status_say_devices(Record *to, GVariant *devices, const char *reason);
