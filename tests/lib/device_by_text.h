/* Devices of all classes, operated by the words of a recording (docs/build-a-rig/recordings.md).
 * Mistakes in the words fail the test. */
#pragma once

#include "base/config.h"
#include "drivers/clock.h"

typedef struct DeviceByText DeviceByText;

/* Returns whether the device of a section can be operated here: it is no camera and not
 * simulated. */
gboolean device_by_text_can(const struct config_section *section);

/* Opens the device of such a section. Returns NULL with an error if it cannot be opened. */
DeviceByText *device_by_text_open(const struct config_section *section, Clock *clock,
                                  GError **error);
void device_by_text_close(DeviceByText *device);

/* Starts what a call of a recording says, such as "move to 5.0000" or "lamp 0 on". */
void device_by_text_call(DeviceByText *device, const char *words);

/* Returns the number of results since the device was opened. */
int device_by_text_results(const DeviceByText *device);
