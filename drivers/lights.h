/*
 * What lamp banks and lasers share: the lights of a device. Each light has a wanted state and a
 * confirmed one. "Off" is a state, not an attempt: a light that should be off is sent "off" until
 * the device has confirmed it, for as long as the device is open. A command that was not answered
 * may have been carried out, so a lost answer to "on" counts as light.
 */
#pragma once

#include "device.h"

/* Starts a command, as the set() of a driver. index -1: all lights, with on FALSE. */
typedef gboolean (*LightsSend)(gpointer device, int index, gboolean on, GError **error);

/* The one answer to a command of lights_set(), called last: it may close the device. */
typedef void (*LightsAnswer)(gpointer device, int index, gboolean on, gint64 at_us,
                             const GError *error);

struct lights;

/* device begins with a struct device; owned by the caller, and closed after lights_free(). many:
 * its lights have numbers that errors name, and one command switches all of them off. */
struct lights *lights_new(gpointer device, int n, gboolean many, LightsSend send,
                          LightsAnswer answer);
void lights_free(struct lights *lights); /* sends nothing more; NULL is ignored */

/* Answered once, unless it fails. The commands to one light are answered in order. */
gboolean lights_set(struct lights *lights, int index, gboolean on, GError **error);

/* For the driver's reports. A report that fits no command is believed if it says that there is
 * light. */
void lights_report(struct lights *lights, int index, gboolean on, const GError *error);

/* The state of all lights is unknown because of this error: switches them off. */
void lights_lost(struct lights *lights, const GError *error);

enum light lights_light(const struct lights *lights, int index);
enum device_safety lights_safety(const struct lights *lights); /* of all its lights */
gint64 lights_since_us(const struct lights *lights, int index); /* of the "on"; -1: none */
