/*
 * A virtual still camera that speaks PTP/IP (CIPA DC-005) on the loopback interface, in separate
 * threads and in real time. It has a card with pictures, lists of shutter times, ISO speeds and
 * apertures, a battery, and events. libgphoto2 drives it like a real camera. Its pictures are raw
 * files (DNG) or JPEG.
 *
 * Any thread may call these functions, except virtual_ptpip_new() and virtual_ptpip_free().
 */
#pragma once

#include "imager.h"

typedef struct VirtualPtpip VirtualPtpip;

struct virtual_ptpip_options {
    const char *host; /* address of the loopback interface; NULL means "127.0.0.1" */
    const char *serial;
    int width, height, bits; /* `bits`: number of bits of a value in the raw file */
    enum cfa cfa;
    double black_level;     /* black level of the raw file */
    VirtualPicture picture; /* NULL for a ramp that differs from picture to picture */
    gpointer data;
    gboolean jpeg; /* pictures are JPEG: grey, sRGB */
    gboolean both; /* each picture is a JPEG and then a raw file */
    /* With `nikon`: pictures are put into the camera's memory, not on the card. The memory holds
     * one picture. A new picture replaces it, even if it was not copied. */
    gboolean memory;
    /* speaks Nikon's dialect: other operations, and events that a program must poll */
    gboolean nikon;
};

/* The faults that virtual_ptpip_fail() sets. Members of type int, except battery, are numbers of
 * triggers, pictures or downloads to which the fault will happen. The number decreases by one each
 * time. */
struct virtual_ptpip_faults {
    int busy;       /* triggers that are refused because the camera is busy */
    int unanswered; /* triggers that are obeyed but never answered */
    int blind;      /* triggers that are answered, but make no picture and no event */
    int incomplete; /* pictures without the event CaptureComplete */
    int unsaid;     /* pictures without the event ObjectAdded */
    /* `late`: number of pictures for which the event ObjectAdded comes late. `late_exposures`:
     * delay of this event in units of the shutter time. */
    int late;
    double late_exposures;
    gboolean complete_first; /* CaptureComplete is sent before ObjectAdded, not after it */
    gboolean same_name;      /* every picture has the same name, as after a reset of the counter */
    int dropped;             /* downloads in the middle of which all connections end */
    int stalled;             /* downloads in the middle of which the camera stops answering */
    gboolean full;           /* the card is full */
    gint64 slow_us;          /* delay from the trigger to the exposure */
    /* When a program sets a shutter time, the camera takes the one that follows in its list. */
    gboolean neighbour;
    gboolean refuses;   /* the camera refuses connections with a packet of PTP/IP */
    gboolean deaf;      /* the camera accepts connections and answers nothing */
    gboolean unplugged; /* all connections end, and none is accepted */
    int battery;        /* charge in percent; 0 means 80 */
};

struct virtual_ptpip_state {
    int triggers;    /* number of triggers that were obeyed */
    int pictures;    /* number of pictures that were put on the card */
    int on_card;     /* number of pictures that are on the card now */
    int connections; /* number of connections that were made, without those for events */
    gint64 shutter_us;
    int iso;
};

/* Makes a camera that listens on a free port. Returns NULL with an error if it cannot listen. */
VirtualPtpip *virtual_ptpip_new(const struct virtual_ptpip_options *options, GError **error);
void virtual_ptpip_free(VirtualPtpip *camera); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(VirtualPtpip, virtual_ptpip_free)

/* Returns the value of "port" for a section of a rig file, such as "ptpip:127.0.0.1:40123:40123".
 * libgphoto2 takes the second number as the port of the connection for events. */
const char *virtual_ptpip_port(const VirtualPtpip *camera);

void virtual_ptpip_fail(VirtualPtpip *camera, const struct virtual_ptpip_faults *faults);
void virtual_ptpip_state(VirtualPtpip *camera, struct virtual_ptpip_state *ret);

/* Changes shutter time and ISO speed, as if somebody had turned the dials of the camera. */
void virtual_ptpip_turn_dials(VirtualPtpip *camera, gint64 shutter_us, int iso);

/* Puts a file on the card, as if somebody had taken a picture by hand. The file is not a raw file.
 * date is the date of the file, such as "20200131T235959", or NULL for now. If says is TRUE, the
 * camera sends an event about the file. */
void virtual_ptpip_put(VirtualPtpip *camera, const char *name, const char *date, gboolean says);
