/*
 * A still camera that libgphoto2 drives. The functions wait, and some of them may wait for ever.
 * Only the end of the process then helps (mesorig-gphoto2.c).
 *
 * A trigger and its picture are only loosely connected in libgphoto2. The picture is announced by
 * an event that may come late or never. The picture of a shot that was given up arrives later, and
 * must not be taken for the next one. Therefore a shot first waits for such pictures and removes
 * them. After its trigger, it waits for the event, at most for three times the exposure plus
 * trigger_ms and readout_ms. If no event has come by then, it looks for a new file on the card.
 *
 * After an error of the connection, the camera is connected again and searched for the picture.
 * Times are those of g_get_monotonic_time(). Errors are G_IO_ERROR without a subject.
 */
#pragma once

#include <glib.h>

typedef struct Still Still;

struct still_options {
    const char *port;            /* "usb", a place on USB, or a port of libgphoto2 */
    const char *model;           /* name in libgphoto2; NULL if libgphoto2 recognises the camera */
    const char *iso, *aperture;  /* NULL leaves the camera's setting as it is */
    const char *shutter;         /* name of the setting; NULL means "shutterspeed" */
    const char *const *settings; /* "NAME=VALUE"; may be NULL */
    gboolean keep_on_card;
    int trigger_ms, readout_ms;
};

/* How a shot waits. pause() waits up to `ms` milliseconds, and returns FALSE if the shot is to be
 * given up. exposed() is called when the exposure has ended. */
struct still_wait {
    gboolean (*pause)(int ms, gpointer data);
    void (*exposed)(gpointer data);
    gpointer data;
};

struct still_shot {
    gint64 exposure_us;
    gint64 deadline_us; /* time at which the shot fails if there is no picture */
    const char *folder; /* folder on this computer for the file of the picture */
    struct still_wait wait;
};

/* Connects a camera, checks its battery and its card, and sets the options, which must live as long
 * as the camera. Returns NULL with an error on failure. */
Still *still_open(const struct still_options *options, GError **error);

/* Ends the connection. NULL is ignored. */
void still_close(Still *still);
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Still, still_close)

/* Return the model and the serial number, which is empty if the camera reports none. The camera
 * owns the strings. */
const char *still_model(const Still *still);
const char *still_serial(const Still *still);

/* Returns the exposure times that the camera offers, in µs, in ascending order. The camera owns
 * them. */
const GArray *still_exposures(const Still *still);

/* Takes a picture with the offered exposure time that is nearest to exposure_us, and copies its
 * file from the camera. Returns the path of the copy, to be freed with g_free(), or NULL with an
 * error. The error is G_IO_ERROR_CANCELLED if pause() has returned FALSE. */
char *still_shoot(Still *still, const struct still_shot *shot, GError **error);

/* Takes the events that wait. Call it now and then while no picture is taken, because it keeps the
 * camera awake. */
void still_idle(Still *still);

/* Prints a line for each camera on USB: place, model, serial number, port, with tabs. Returns FALSE
 * with an error if the bus cannot be searched. */
gboolean still_list(GError **error);
