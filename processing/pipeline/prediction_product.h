/*
 * Pictures of a BTF that were left out on purpose ([lights] sampling = adaptive), predicted from
 * all that were taken (prediction/prediction.h): their parts of the views' files are made again
 * once all views are there. Until then they hold the values that btf_make_view() interpolates from
 * the lights around them.
 *
 * Such a part has the flag BTF_FLAG_PREDICTED in all texels, error bars (btf_sigma.h), the int
 * mesorig.left_out and the string mesorig.prediction: the hash of all views' inputs.
 */
#pragma once

#include "catalogue.h"

/* Version of the method of prediction, as BTF_METHOD is the version of the measured values. */
#define PREDICTION_METHOD 1

struct prediction_product {
    int n_left_out, n_pictures; /* of all n_pictures in the BTF */
    char *inputs;               /* hash; NULL: nothing was left out */
    gboolean made;              /* FALSE: the files were up to date */
};
void prediction_product_clear(struct prediction_product *product);

/* What the session records about its predicted pictures. left_out 0: there are none. */
struct prediction_known {
    int left_out, pictures;
    double error;          /* expected, relative to the whole BTF (prediction_error()) */
    double left_out_error; /* of cross-validation: of pictures that were taken */
    double left_out_share; /* of their values within 2 σ */
};
void prediction_product_read(Session *session, struct prediction_known *ret);

/* views: indices of views whose files are there. Sets the session's values "prediction_error"
 * (expected, relative: prediction_error()), "prediction_left_out_error",
 * "prediction_left_out_share" and "prediction_pictures" (“2700 of 3600”). The texels' values are
 * kept in a scratch file if they take more than PREDICTION_PRODUCT_MEMORY bytes; predicted values
 * are kept in memory, 12 bytes per texel and picture. Progress stage "prediction". */
#define PREDICTION_PRODUCT_MEMORY ((gint64)1 << 30)
gboolean prediction_product_make(Session *session, const struct catalogue *catalogue,
                                 const int *views, int n_views, const struct work *work,
                                 struct prediction_product *ret, GError **error);
