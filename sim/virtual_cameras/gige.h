/*
 * A virtual GigE Vision camera that speaks the real protocol on the loopback interface, in threads
 * of its own and in real time: GVCP with discovery, registers, heartbeat and packet resend, GVSP
 * with test packets, and a GenICam file that it serves itself. The creator supplies its pictures.
 *
 * Aravis has a fake camera, too, but it has no resend, no time stamp latch, no exposure that takes
 * time and no trigger line, and does not answer on its control channel while it makes a picture;
 * none of this could be tested with it.
 *
 * Any address of 127.0.0.0/8 will do; no network has to be set up. Any thread may call these
 * functions, except new and free.
 */
#pragma once

#include "imager.h"

#include <gio/gio.h>

typedef struct VirtualGige VirtualGige;

/* address: "127.0.0.9"; NULL: a free one. Errors: the address is in use. */
VirtualGige *virtual_gige_new(const struct virtual_camera_options *options, const char *address,
                              GError **error);
void virtual_gige_free(VirtualGige *camera); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(VirtualGige, virtual_gige_free)

/* The value of "device" in a section; "GE-" and the serial number work too. */
const char *virtual_gige_address(const VirtualGige *camera);

void virtual_gige_fail(VirtualGige *camera, const struct virtual_camera_faults *faults);

/* Simulates that another program takes control; it gives control back when steal is FALSE. */
void virtual_gige_steal(VirtualGige *camera, gboolean steal);

/* Power off and, after down_ms, on again, with all registers as they were at first. */
void virtual_gige_restart(VirtualGige *camera, int down_ms);

/* A pulse on its input, "Line0". */
void virtual_gige_pulse(VirtualGige *camera);

void virtual_gige_state(VirtualGige *camera, struct virtual_camera_state *ret);
