/*
 * A camera that is nothing but its GenICam file: registers remember what is written to them and do
 * nothing. Aravis reads and writes features through them as it does with a real camera.
 */
#pragma once

#include <arv.h>

/* xml is copied. fill: what each byte of a register reads before it is written; vendor and model
 * are those of the file. Never NULL; arv_device_get_genicam() is NULL if the file cannot be read.
 */
ArvDevice *described_camera_new(const char *xml, gsize size, guint8 fill);

/* How many registers were written. */
guint described_camera_writes(ArvDevice *device);
