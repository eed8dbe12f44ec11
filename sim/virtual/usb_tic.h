/*
 * A virtual Pololu Tic with a motor, a load and two limit switches, for tests and for mesorig-rig.
 * It implements the states, errors and homing of the user's guide
 * (https://www.pololu.com/docs/0J71) for the control mode "Serial / I2C / USB", in real time.
 */
#pragma once

#include "usb_device.h"
#include "world_link.h"

typedef struct VirtualTic VirtualTic;

/* Makes a Tic that has just been switched on. The motor stands at `at`, and may turn from 0 to
 * travel steps, between its switches. If travel is 0, there are no switches and no limits. */
VirtualTic *virtual_tic_new(const char *serial, int port, double travel, double at);
void virtual_tic_free(VirtualTic *tic);
G_DEFINE_AUTOPTR_CLEANUP_FUNC(VirtualTic, virtual_tic_free)

VirtualUsb *virtual_tic_usb(VirtualTic *tic);

/* Connects the motor to a part of the world ("turntable", "arc", "sweep NAME"). The part is at 0°
 * when the motor is at zero_steps. If steps_per_deg is negative, the part turns the other way. The
 * world is updated at every request to the Tic; the driver sends requests continuously. */
gboolean virtual_tic_link(VirtualTic *tic, World *world, const char *part, double steps_per_deg,
                          double zero_steps, GError **error);

/* Changes settings, as an owner does with the programs of Pololu. */
void virtual_tic_set_mode(VirtualTic *tic, int control_mode, int command_timeout_ms);

/* Imitates another program that makes the Tic enter safe start. */
void virtual_tic_enter_safe_start(VirtualTic *tic);
void virtual_tic_lose_steps(VirtualTic *tic); /* the position becomes uncertain */
/* If blocked is TRUE, the forward switch stays pressed. If blocked is FALSE, it works again. */
void virtual_tic_block_switch(VirtualTic *tic, gboolean blocked);
void virtual_tic_cut_switches(VirtualTic *tic); /* the motor never finds a switch from now on */

double virtual_tic_steps(VirtualTic *tic);     /* true position of the motor */
double virtual_tic_speed(VirtualTic *tic);     /* steps per second */
double virtual_tic_top_speed(VirtualTic *tic); /* highest speed so far, steps per second */
gboolean virtual_tic_has_timed_out(VirtualTic *tic);
