/* Replays recordings of devices (docs/build-a-rig/recordings.md) with their drivers. */
#pragma once

#include "virtual/replay/recorded.h"

/* Does the calls of a recording, each as soon as the requests before it have come. The devices must
 * send the requests of the recording, and do and report what they did and reported. Returns the
 * first difference, or NULL; g_free(). */
char *replaying(const Recorded *recorded);

/* Replays the text of a recording. A difference fails the test. path is the name of the recording
 * in messages. */
void replaying_well(const char *text, const char *path);
