/*
 * The outputs of a device that give light: what lamp banks and lasers share. Each output has a
 * wanted state and a confirmed one. "Off" is a state, not an attempt: an output that should be off
 * is sent "off" again and again until the device has confirmed it, for as long as the device is
 * open. A command that was not answered may have been carried out, so a lost answer to "on" counts
 * as light.
 */
#pragma once

#include "device.h"

/* Starts a command, as the set() of a driver. index -1: all outputs, with on FALSE. */
typedef gboolean (*OutputsSend)(gpointer device, int index, gboolean on, GError **error);

/* The one answer to a command of outputs_set(), called last: it may close the device. */
typedef void (*OutputsAnswer)(gpointer device, int index, gboolean on, const GError *error);

struct outputs;

/* device begins with a struct device; owned by the caller, and closed after outputs_free(). many:
 * its outputs have numbers that errors name, and one command switches all of them off. */
struct outputs *outputs_new(gpointer device, int n, gboolean many, OutputsSend send,
                            OutputsAnswer answer);
void outputs_free(struct outputs *outputs); /* sends nothing more; NULL is ignored */

/* Answered once, unless it fails. Commands are answered in order. */
gboolean outputs_set(struct outputs *outputs, int index, gboolean on, GError **error);

/* For the driver's reports. A report that fits no command is believed if it says that there is
 * light. */
void outputs_report(struct outputs *outputs, int index, gboolean on, const GError *error);

/* The state of all outputs is unknown because of this error: switches them off. */
void outputs_lost(struct outputs *outputs, const GError *error);

enum light outputs_light(const struct outputs *outputs, int index);
enum device_safety outputs_safety(const struct outputs *outputs); /* of all its outputs */
gint64 outputs_confirmed_us(const struct outputs *outputs, int index);
gint64 outputs_since_us(const struct outputs *outputs, int index); /* of the "on"; -1: none */
gint64 outputs_burnt_us(const struct outputs *outputs, int index);
