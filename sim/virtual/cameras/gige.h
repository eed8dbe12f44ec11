/*
 * A virtual GigE Vision camera that speaks the real protocol on the loopback interface, in separate
 * threads and in real time:
 * - GVCP with discovery, registers, heartbeat and packet resend
 * - GVSP with test packets
 * - a GenICam file of its own
 *
 * The pictures come from the function options->picture.
 *
 * Aravis also has a fake camera. It has no resend, no time stamp latch, no exposure that takes time
 * and no trigger line, so it cannot test these functions. While it makes a picture, it does not
 * answer on its control channel.
 *
 * Any address of 127.0.0.0/8 can be used without setting up a network. Any thread may call these
 * functions, except virtual_gige_new() and virtual_gige_free().
 */
#pragma once

#include "imager.h"

#include <glib.h>

typedef struct VirtualGige VirtualGige;

/* Makes a camera. address is for example "127.0.0.9", or NULL for a free address. Returns NULL with
 * an error if the address is in use, or if no free address is found. */
VirtualGige *virtual_gige_new(const struct virtual_camera_options *options, const char *address,
                              GError **error);
void virtual_gige_free(VirtualGige *camera); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(VirtualGige, virtual_gige_free)

/* Returns the address, which is a value of "device" for a section of a rig file. Another possible
 * value is "GE-" and the serial number. */
const char *virtual_gige_address(const VirtualGige *camera);

void virtual_gige_fail(VirtualGige *camera, const struct virtual_camera_faults *faults);

/* Simulates another program. If steal is TRUE, this program takes control of the camera. If steal
 * is FALSE, it releases the camera. */
void virtual_gige_steal(VirtualGige *camera, gboolean steal);

/* Switches the power off, and on again after down_ms. All registers then have their initial values.
 * The function does not wait. */
void virtual_gige_restart(VirtualGige *camera, int down_ms);

/* Sends a pulse to the input "Line0". */
void virtual_gige_pulse(VirtualGige *camera);

void virtual_gige_state(VirtualGige *camera, struct virtual_camera_state *ret);
