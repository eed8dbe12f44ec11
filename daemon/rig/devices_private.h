/* The contents of a rig file, before any device is opened. While the file is read, a member is NULL
 * or FALSE if a mistake in the file prevents its value. layout_read() succeeds only if there is no
 * mistake. */
#pragma once

#include "devices.h"

struct layout_device { /* a section with a driver */
    const struct config_section *section;
    const struct driver_info *info;
    gpointer fields; /* the values of the driver's options */
};

struct layout_bank { /* a section [lamps NAME] */
    const struct config_section *section;
    GArray *places; /* of struct lamp_place; NULL after a mistake in the section */
};

struct layout {
    Config *config;
    GArray *devices; /* of struct layout_device */
    struct rig geometry;
    /* FALSE if a heading is wrong. A section that is not found may then be the one with the wrong
     * heading. */
    gboolean has_all_sections;
    gboolean virtual_clock, checks_drivers;
    char *calibration_path; /* absolute path of the calibration; NULL if the file names none */
    double calibration_days;
    const struct config_section *turntable, *arc, *arm, *probe;
    /* One axis may be the sweep of several lasers. */
    const struct config_section *sweeps[RIG_MAX_LASERS];
    /* All stops of one camera or lamp have the same section. All lamps that a section [lamps
     * NAME] places have that section. */
    const struct config_section *cameras[RIG_MAX_CAMERAS], *lamps[RIG_MAX_LAMPS];
    const struct config_section *lasers[RIG_MAX_LASERS];
    /* index of the laser unit that is mounted at each laser's position */
    int unit[RIG_MAX_LASERS];
    struct layout_bank banks[DEVICES_MAX_BANKS];
    const struct config_section *interlocks[DEVICES_MAX_INTERLOCKS];
    int n_banks, n_interlocks;
    int lamp_bank[RIG_MAX_LAMPS], lamp_index[RIG_MAX_LAMPS];
};

/* A key of [axis NAME] that is read here and not by the driver. It sets park_deg in struct Axis. */
#define LAYOUT_PARK_KEY "park_deg"

/* Reads a rig file. text is the content of the file, or NULL to read the file at path. Checks
 * everything that can be checked without a device, including the options of drivers. If
 * checks_drivers is TRUE, also finds options of one driver that do not fit each other, mistakes in
 * files that the options name, and conflicts between sections. It must be TRUE if the devices are
 * to be opened. The error lists all mistakes of the file. */
gboolean layout_read(struct layout *layout, const char *path, const char *text,
                     gboolean checks_drivers, GError **error);
void layout_clear(struct layout *layout);

/* Returns the driver of a section and the values of its options. Returns NULL if the section has no
 * driver, or if these options have mistakes. */
const struct layout_device *layout_device(const struct layout *layout,
                                          const struct config_section *section);

/* Returns the text of the rig file as a session keeps it. References to files of positions are left
 * out, and their lamps are written as sections [lamp NAME]. Free it with g_free(). */
char *layout_text(const struct layout *layout);

/* Returns the keys that the rig reads in a section of a class, in addition to the driver's keys.
 * The list is NULL-terminated. Free only the list, with g_free(). */
const char **layout_keys(const char *class_name);

/* Returns the driver that the key "driver" of a section names: a struct of the section's class,
 * which begins with a struct driver_info. The error lists the existing drivers of that class. */
gconstpointer drivers_find(const struct config_section *section, GError **error);
/* Returns the driver, of any class, that the section's key "driver" names. Returns NULL if there is
 * none. */
const struct driver_info *drivers_by_name(const struct config_section *section);
