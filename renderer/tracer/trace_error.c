#include "trace_error.h"

G_DEFINE_QUARK(trace_error, trace_error)
