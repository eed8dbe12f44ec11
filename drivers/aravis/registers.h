/* Records the registers of cameras (drivers/recording.h). Any thread. */
#pragma once

#include <arv.h>

/* From now on, what the camera's registers are read and written with is recorded. name is the name
 * of the camera in Aravis. Does nothing if nothing is being recorded. */
void aravis_registers_record(ArvDevice *device, const char *name);
