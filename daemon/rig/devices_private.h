/* The rig file as it was read and checked, before any device is opened. */
#pragma once

#include "devices.h"

struct layout {
    Config *config;
    struct rig geometry;
    gboolean has_all_sections; /* FALSE: a heading is wrong, so that what seems missing may be it */
    gboolean virtual_clock, checks_drivers;
    char *calibration_path; /* absolute; NULL: none is named */
    double calibration_days;
    const struct config_section *turntable, *arc, *arm, *probe;
    const struct config_section *sweeps[RIG_MAX_LASERS]; /* one may be the sweep of several */
    /* All stops of one camera or lamp have the same section. */
    const struct config_section *cameras[RIG_MAX_CAMERAS], *lamps[RIG_MAX_LAMPS];
    const struct config_section *lasers[RIG_MAX_LASERS];
    int unit[RIG_MAX_LASERS]; /* index of the laser unit that is mounted here */
    const struct config_section *banks[DEVICES_MAX_BANKS];
    const struct config_section *interlocks[DEVICES_MAX_INTERLOCKS];
    int n_banks, n_interlocks;
    int lamp_bank[RIG_MAX_LAMPS], lamp_index[RIG_MAX_LAMPS];
};

/* A key of [axis NAME], which the rig reads and not the driver (park_deg in struct Axis). */
#define LAYOUT_PARK_KEY "park_deg"

/* Checks everything that can be checked without a device, also the options of drivers.
 * checks_drivers, for devices that are to be opened: also lets drivers check which options fit each
 * other, and other files that these name. The error tells all mistakes of the file. */
gboolean layout_load(struct layout *layout, const char *path, gboolean checks_drivers,
                     GError **error);
gboolean layout_parse(struct layout *layout, const char *text, const char *path, GError **error);
void layout_clear(struct layout *layout);

/* Reports each section that needs what a section above it in the file needs for itself. */
void layout_check_needs(const Config *config, Mistakes *mistakes);

/* The keys that the rig reads in a section of a class beside the driver's, NULL-terminated; free
 * the list alone with g_free(). */
const char **layout_keys(const char *class_name);

/* The driver that the driver key of a section names: a struct of the section's class, which begins
 * with a struct driver_info. The error lists the existing drivers of that class. */
gconstpointer drivers_find(const struct config_section *section, GError **error);
/* Finds the driver, of any class, that the section's key "driver" names; NULL: there is none. */
const struct driver_info *drivers_by_name(const struct config_section *section);
