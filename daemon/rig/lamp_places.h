/* The places of the lamps of a bank, as one key of the section [lamps NAME] gives them: rings, a
 * spiral over a part of the hemisphere, an arc, or a file. Every lamp gets the values that a
 * section [lamp NAME] would have.
 *
 * The lamps of a bank are numbered from 1 in the order in which they are described. A lamp without
 * a name in a table is named after the bank and its number: dome_01, dome_02, … The number has at
 * least two digits, or at least three if the bank has more than 99 lamps. */
#pragma once

#include "base/options.h"
#include "geometry/rig.h"

/* The values of the keys of [lamps NAME] that place lamps (devices_bank_options). */
struct bank_fields {
    int count, first_index;
    char **rings, *positions;
    struct option_doubles theta_deg;
    double theta_from_deg, theta_to_deg, phi_deg, distance_mm, exponent, intensity;
};

struct lamp_place {
    char name[RIG_NAME];
    /* bank of the lamp in the column bank of a table; empty if there is none */
    char bank[RIG_NAME];
    int line;  /* line of the lamp in the table; 0 without a table */
    int index; /* number in the bank, from 0 */
    double theta_deg, phi_deg, distance_mm, exponent, intensity;
};

/* Returns the key of a section [lamps NAME] that says where its lamps are. Returns NULL if there is
 * none, and for a section of another class. */
const char *lamp_places_key(const struct config_section *section);

/* Returns the lamps of a section [lamps NAME] in their order (of struct lamp_place), or an empty
 * array if lamp_places_key() is NULL. Free the array with g_array_unref(). fields are the values of
 * the section. Leaves out lamps that a table gives to another bank. Adds mistakes and returns NULL
 * if a value is wrong, the keys do not fit each other, the file has a mistake, or a name would be
 * too long. */
GArray *lamp_places_new(const struct bank_fields *fields, const struct config_section *section,
                        Mistakes *mistakes);

/* Reads a file of positions of lamps. A file whose name ends with ".lp" is a list: first the number
 * of lights, then for each light the name of a picture, which is ignored, and x y z. Any other file
 * is a table (base/text_table.h) with the columns x_mm, y_mm and z_mm, or theta_deg, phi_deg and
 * distance_mm. The columns name, bank, index, exponent and intensity are optional.
 *
 * `otherwise` has the values for all that the file does not give. If otherwise->distance_mm is 0, x
 * y z in a list are a position in millimetres. If it is above 0, x y z is only a direction, and a
 * table need not have the column distance_mm. If the file gives no name, the name of the lamp is
 * empty; if it gives no index, the index is −1. Returns an array of 1 to RIG_MAX_LAMPS struct
 * lamp_place, or NULL with DATA_ERROR_INVALID, file and line. */
GArray *lamp_places_read(const char *path, const struct lamp_place *otherwise, GError **error);
