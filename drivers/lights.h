/*
 * The lights of a device: the code that lamp banks and lasers share. Each light has a wanted state
 * and a confirmed state. "Off" is a state that must be reached, not a single attempt. A light that
 * should be off is sent "off" until the device has confirmed it, as long as the device is open. A
 * command that was not answered may have been carried out. After an "on" without an answer the
 * light is therefore taken to be on.
 */
#pragma once

#include "device.h"

/* Starts a command, like set() of a driver (lamps.h). Index -1 stands for all lights; `on` is then
 * FALSE. */
typedef gboolean (*LightsSend)(gpointer device, int index, gboolean on, GError **error);

/* Called exactly once for each lights_set() that did not fail. at_us is the time of the device's
 * answer or of the deadline. error is NULL if the device has confirmed the command. This function
 * may close the device, so its caller does not use the device after the call. */
typedef void (*LightsAnswer)(gpointer device, int index, gboolean on, gint64 at_us,
                             const GError *error);

struct lights;

/* Makes the lights of a device. device begins with a struct device. The caller owns device, and
 * closes it after lights_free(). many is TRUE for a device with several lights: errors then name
 * the number of a light, and one command can switch all lights off. */
struct lights *lights_new(gpointer device, int n, gboolean many, LightsSend send,
                          LightsAnswer answer);
void lights_free(struct lights *lights); /* sends nothing afterwards; NULL is ignored */

/* Switches a light. If this returns TRUE, LightsAnswer is called once. The commands to one light
 * are answered in order. */
gboolean lights_set(struct lights *lights, int index, gboolean on, GError **error);

/* Takes the report of a driver. A report that fits no command is used only if it says that there is
 * light. */
void lights_report(struct lights *lights, int index, gboolean on, const GError *error);

/* Says that the state of all lights is unknown because of the error. Switches them off. */
void lights_lost(struct lights *lights, const GError *error);

enum light lights_light(const struct lights *lights, int index);
enum device_safety
lights_safety(const struct lights *lights); /* the state of all lights together */
