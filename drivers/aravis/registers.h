/* Records the registers of cameras (drivers/recording.h). Any thread may call the functions. */
#pragma once

#include <arv.h>

/* Records every read and write of a register of the camera from now on. name is the name of the
 * camera in Aravis. Does nothing if nothing is being recorded. */
void aravis_registers_record(ArvDevice *device, const char *name);
