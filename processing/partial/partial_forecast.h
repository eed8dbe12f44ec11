/*
 * The prediction of the pictures that a session does not have yet, with its expected error now and
 * after further shots. The model is selection/nearest_prediction.h. A PartialForecast is constant
 * and counted by references; any thread.
 */
#pragma once

#include "partial.h"
#include "selection/nearest_prediction.h"

typedef struct PartialForecast PartialForecast;

/* The expected error after n further shots of the session, in the planned order. Shots of all kinds
 * count. */
struct partial_later {
    int shots;
    double error;
};
#define PARTIAL_LATER 6

/* Makes a forecast. `like` is an earlier forecast of the same session, or NULL. The sample must
 * have measured pairs.
 *
 * A new model is fitted if `like` is NULL, or if the number of measured pairs has grown by a
 * quarter since the model of `like` was fitted. A fit takes seconds. If none is needed, the model
 * of `like` is used, which takes a fraction of this time. Errors are those of
 * nearest_prediction_new(). */
PartialForecast *partial_forecast_new(const struct partial_sample *sample,
                                      const PartialForecast *like, const struct work *work,
                                      GError **error);
PartialForecast *partial_forecast_ref(PartialForecast *forecast);
void partial_forecast_unref(PartialForecast *forecast); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(PartialForecast, partial_forecast_unref)

/* Returns the number of measured pairs of the sample from which the forecast was made. */
int partial_forecast_n_measured(const PartialForecast *forecast);
/* partial_forecast_error() returns the expected relative error of the whole BTF
 * (nearest_prediction_error()). partial_forecast_pair_error() returns the expected error of a pair,
 * relative to the values of this pair (nearest_prediction_pair_error()). */
double partial_forecast_error(const PartialForecast *forecast);
double partial_forecast_pair_error(const PartialForecast *forecast, int pair);
/* Gives the range of the error of the whole BTF (nearest_prediction_error_range()). */
void partial_forecast_error_range(const PartialForecast *forecast, double ret[2]);
/* Returns the expected errors after further shots, sorted by the number of shots. *ret_n receives
 * the number of elements, at most PARTIAL_LATER. The array is owned by the forecast. */
const struct partial_later *partial_forecast_later(const PartialForecast *forecast, int *ret_n);

/* Predicts the picture of a pair u from the measured pictures i, with the exact directions of each
 * texel: ρ_u = g_u Σ_i w_i ρ_i / g_i, at least 0. w_i are the weights of
 * nearest_prediction_weights(), and g is nearest_prediction_mean(). The picture has the form of
 * partial_picture(); g_bytes_unref(). Returns NULL for a pair that the forecast counts as measured.
 * Call this function only in the thread to which the Partial belongs. */
GBytes *partial_forecast_picture(const PartialForecast *forecast, const Partial *partial, int pair);
