/* Predicts the pictures of a BTF that were left out on purpose ([lights] sampling = adaptive), from
 * all pictures that were taken (selection/prediction.h). When all views exist, the parts of the
 * left-out pictures in the views' files are made again. Until then these parts hold the values that
 * btf_make_view() interpolates from the lights around them.
 *
 * The predicted part of a left-out picture has the flag BTF_FLAG_PREDICTED in all texels, and error
 * bars (btf_sigma.h). Its attributes are mesorig.left_out (int) and mesorig.prediction (string: the
 * hash of the inputs of all views). */
#pragma once

#include "catalogue.h"

/* Version of the method of prediction. BTF_METHOD is the version of the method for measured
 * values. */
#define PREDICTION_METHOD 1

struct prediction_product {
    /* number of left-out pictures, and number n_pictures of all pictures of the BTF */
    int n_left_out, n_pictures;
    /* number of captured pictures from which the others are predicted: all of them, but at most
     * PREDICTION_MAX_MEASURED */
    int n_used;
    char *inputs; /* hash; NULL if nothing was left out */
    /* FALSE if the files were up to date, or if no picture was left out */
    gboolean made;
};
void prediction_product_clear(struct prediction_product *product);

/* The session's record of its predicted pictures. left_out is 0 if there are none. */
struct prediction_known {
    int left_out, pictures;
    double error; /* expected error, relative to the whole BTF (prediction_error()) */
    /* relative error of pictures that were taken, in cross-validation
     * (prediction_left_out_error()) */
    double left_out_error;
    double left_out_share; /* share of the values in cross-validation whose error is within 2 σ */
};
void prediction_product_read(Session *session, struct prediction_known *ret);

/* Predicts the left-out pictures. views has the indices of views whose files exist. Does nothing if
 * no picture was left out, or if all predictions are up to date. Fails if a file lacks lights or
 * positions, or if products/btf has other views. The progress stages are "read", then "prediction"
 * for fitting, then "prediction" for predicting.
 *
 * Sets the session's values "prediction_error" (expected, relative: prediction_error()),
 * "prediction_left_out_error", "prediction_left_out_share" and "prediction_pictures" (“2700 of
 * 3600”).
 *
 * The texels' values are kept in a scratch file if they take more than PREDICTION_PRODUCT_MEMORY
 * bytes. Predicted values are kept in memory, 12 bytes per texel and picture. */
#define PREDICTION_PRODUCT_MEMORY ((gint64)1 << 30)
gboolean prediction_product_make(Session *session, const struct catalogue *catalogue,
                                 const int *views, int n_views, const struct work *work,
                                 struct prediction_product *ret, GError **error);
