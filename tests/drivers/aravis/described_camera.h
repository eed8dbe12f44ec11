/*
 * A camera that consists only of its GenICam file: registers store what is written to them and have
 * no effect. Aravis reads and writes features through them as it does with a real camera.
 */
#pragma once

#include <arv.h>

/* xml is copied. fill: what each byte of a register reads before it is written; vendor and model
 * are those of the file. Never NULL; arv_device_get_genicam() is NULL if the file cannot be read.
 */
ArvDevice *described_camera_new(const char *xml, gsize size, guint8 fill);

/* How many registers were written. */
guint described_camera_writes(ArvDevice *device);
