#include "mdf_file.h"

struct exr_part *mdf_file_add_view(struct exr_file *file, int view, int width, int height,
                                   double theta_deg, double phi_deg, double texel_mm) {
    static const char *const channels[] = {"D", NULL};
    g_autofree char *name = g_strdup_printf("view_%04d", view);
    struct exr_part *part = exr_part_new(name, width, height, channels, EXR_FLOAT);
    exr_set_double(part, "view.theta_deg", theta_deg);
    exr_set_double(part, "view.phi_deg", phi_deg);
    exr_set_double(part, "texel_mm", texel_mm);
    exr_file_add(file, part);
    return part;
}
