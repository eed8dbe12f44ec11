/* The parts of virtual GenICam cameras that are the same on every bus. imager.c has the registers,
 * the trigger, the exposure and the pictures. imager_genicam.c makes the GenICam file that
 * describes the registers. imager_pixels.c writes pictures as bytes. */
#pragma once

#include "imager.h"

/* The camera's own registers, of four bytes each. */
#define REG_BEGIN         0x1100
#define REG_WIDTH         0x1100
#define REG_HEIGHT        0x1104
#define REG_OFFSET_X      0x1108
#define REG_OFFSET_Y      0x110c
#define REG_FORMAT        0x1110
#define REG_ACQUISITION   0x1114
#define REG_EXPOSURE_US   0x1118
#define REG_GAIN          0x111c /* unit 1/100 dB */
#define REG_BLACK         0x1120 /* unit 1/10 DN */
#define REG_TRIGGER_MODE  0x1124
#define REG_TRIGGER_FROM  0x1128 /* 0 Line0, 1 Software */
#define REG_TRIGGER       0x112c
#define REG_SENSOR_WIDTH  0x1130
#define REG_SENSOR_HEIGHT 0x1134
#define REG_PAYLOAD       0x1138
#define REG_AUTO_EXPOSURE 0x113c
#define REG_PROCESSING    0x1140 /* VIRTUAL_PROCESSING registers */
#define REG_END           0x1180

#define GENICAM_AT 0x10000 /* address of the GenICam file */

#define MIN_EXPOSURE_US 10
#define MAX_EXPOSURE_US 60000000
#define MAX_GAIN        2400

#define TRIGGER_LINE     0 /* values of REG_TRIGGER_FROM */
#define TRIGGER_SOFTWARE 1

#define IMAGER_N_KEPT 2

struct imager_picture {
    guint64 id; /* counts from 1 */
    gint64 stamp_us;
    guint32 format, width, height, x, y;
    guint8 *data;
    gsize size;
    gboolean cut; /* the picture ends in its middle */
};

/* How pictures are sent on a bus. The functions are called with the mutex locked. */
struct imager_bus {
    /* Sends the beginning of a picture before its data exist (virtual_camera_faults.announces). */
    void (*announce)(const struct imager_picture *picture, gpointer data);
    void (*send)(gpointer data); /* sends kept[0]; may unlock the mutex for a while */
};

struct imager {
    struct virtual_camera_options options;
    const struct imager_bus *bus;
    gpointer data;
    char *xml;
    gsize xml_size;
    GThread *thread;

    GMutex mutex; /* guards the following members */
    GCond cond;
    guint32 regs[(REG_END - REG_BEGIN) / 4];
    struct virtual_camera_faults faults;
    struct virtual_camera_state state;
    gboolean quit, triggered, exposing;
    guint64 last_id;
    struct imager_picture kept[IMAGER_N_KEPT]; /* the latest picture first */
};

/* Initializes an imager and takes ownership of xml. Registers get their initial values.
 * imager_start() starts the thread. */
void imager_init(struct imager *imager, const struct virtual_camera_options *options, char *xml,
                 const struct imager_bus *bus, gpointer data);
void imager_start(struct imager *imager);
void imager_quit(struct imager *imager); /* ends the thread, if it was started */
void imager_clear(struct imager *imager);

void imager_fail(struct imager *imager, const struct virtual_camera_faults *faults);
void imager_pulse(struct imager *imager); /* sends a pulse to the input line */

/* Call all functions below with the mutex locked. */

guint32 imager_reg(const struct imager *imager, guint address);
void imager_set_reg(struct imager *imager, guint address, guint32 value);
static inline gboolean imager_has_reg(guint64 address) {
    return address >= REG_BEGIN && address < REG_END;
}

void imager_reset(struct imager *imager); /* registers get their initial values */
void imager_stop(struct imager *imager);
/* Writes a register and triggers its effect. */
void imager_write(struct imager *imager, guint address, guint32 value);
void imager_get_state(struct imager *imager, struct virtual_camera_state *ret);

/* Returns the byte of the GenICam file at this address. The file begins at GENICAM_AT. Returns 0
 * after the end of the file. */
guint8 imager_xml_byte(const struct imager *imager, guint64 address);

/* imager_genicam.c */

struct imager_xml {
    GString *text;
    const char *endianness; /* in the spelling of GenICam */
};

struct imager_transport { /* the parts of the file that depend on the bus */
    /* `space` is the name space of the standard. `features` has names separated by spaces. */
    const char *space, *endianness, *features;
    void (*add)(struct imager_xml *xml);
};

/* Returns the GenICam file. processing describes further elements of the file, or is NULL. Free the
 * result with g_free(). */
char *imager_genicam(enum cfa cfa, const struct imager_transport *transport,
                     const struct virtual_processing *processing);

void imager_xml_register(struct imager_xml *xml, const char *name, guint address, int length,
                         const char *access);
/* Adds an integer feature with its register. limits has elements such as <Min> and <pMax>. */
void imager_xml_integer(struct imager_xml *xml, const char *name, guint address, int length,
                        const char *access, const char *limits);
void imager_xml_string(struct imager_xml *xml, const char *name, guint address, int length);
void imager_xml_command(struct imager_xml *xml, const char *name, const char *reg, int value);

/* imager_pixels.c */

/* Appends an element EnumEntry for each format that the colour filter array allows. */
void imager_append_formats(GString *xml, enum cfa cfa);
guint32 imager_first_format(enum cfa cfa); /* the first format of 8 bits */

/* Returns the size of a picture in bytes, or 0 if the format does not exist or does not fit the
 * colour filter array. */
gsize imager_payload(guint32 format, enum cfa cfa, int width, int height);

/* Packs n values in a format. The values are first shifted from `bits` bits to the number of bits
 * of the format. imager_payload() of the format must not be 0. */
void imager_pack(guint32 format, enum cfa cfa, const guint16 *pixels, gsize n, int bits,
                 guint8 *to);
