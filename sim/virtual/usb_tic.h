/*
 * A Pololu Tic with a motor, a load and two limit switches, for tests: what the user's guide
 * (https://www.pololu.com/docs/0J71) says of states, errors and homing in the control mode
 * "Serial / I2C / USB", in real time.
 */
#pragma once

#include "usb_device.h"
#include "world_link.h"

typedef struct VirtualTic VirtualTic;

/* The motor may turn from 0 to travel steps between its switches, and stands at `at`; its power has
 * just been switched on. travel 0: no switches and no limits. */
VirtualTic *virtual_tic_new(const char *serial, int port, double travel, double at);
void virtual_tic_free(VirtualTic *tic);
G_DEFINE_AUTOPTR_CLEANUP_FUNC(VirtualTic, virtual_tic_free)

VirtualUsb *virtual_tic_usb(VirtualTic *tic);

/* The motor turns a part of the world ("turntable", "arc", "sweep NAME"), which is at 0° when the
 * motor is at zero_steps; a negative steps_per_deg turns it the other way. Every request to the Tic
 * brings the world up to date, and the driver polls the Tic all the time. */
gboolean virtual_tic_link(VirtualTic *tic, World *world, const char *part, double steps_per_deg,
                          double zero_steps, GError **error);

/* Changes the settings that an owner makes with Pololu's own programs. */
void virtual_tic_set_mode(VirtualTic *tic, int control_mode, int command_timeout_ms);

void virtual_tic_enter_safe_start(VirtualTic *tic); /* as by another program */
void virtual_tic_lose_steps(VirtualTic *tic);       /* the position becomes uncertain */
void virtual_tic_block_switch(VirtualTic *tic, gboolean blocked); /* forward: stays pressed */
void virtual_tic_cut_switches(VirtualTic *tic);                   /* homing never finds any */

double virtual_tic_steps(VirtualTic *tic);     /* where the motor truly is */
double virtual_tic_speed(VirtualTic *tic);     /* steps per second */
double virtual_tic_top_speed(VirtualTic *tic); /* the fastest it ever was */
gboolean virtual_tic_has_timed_out(VirtualTic *tic);
