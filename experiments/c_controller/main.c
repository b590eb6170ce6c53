/*
 * The servo-constraint law and its allocation as a controller: called at 1 kHz against the forward dynamics.
 *
 * Everything named occ_... has been exported from the model; this file only calls it.
 */
#define _POSIX_C_SOURCE 199309L

#include "occ_box_torque.h"
#include "occ_constraint.h"
#include "occ_forward.h"
#include "occ_power.h"
#include "occ_program_position.h"
#include "occ_program_velocity.h"
#include "occ_servo_wrench.h"

#include <math.h>
#include <stdio.h>
#include <time.h>

enum { STATES = 6, WHEELS = 4, SUBSTEPS = 4, CALLS = 200000 };

static const double POINT[2] = {0.40, 0.05};                     /* B in the body frame [m] */
static const double MOTION[3] = {0.70, -0.4, 1.5707963267948966}; /* radius [m], rate [rad/s], phase [rad] */
static const double LIMIT = 1.2;                                 /* of each wheel's torque [N m] */
static const double PERIOD = 1e-3;                               /* of the controller [s] */
static const double LAP = 15.707963267948966;                    /* [s] */

/* The controller: wrench of the law, then torques of least norm within the limit. */
static void control(double t, const double state[STATES], double torque[WHEELS])
{
    double wrench[3];
    occ_servo_wrench(t, state, POINT, MOTION, wrench);
    occ_box_torque(wrench, LIMIT, torque);
}

/* Runge-Kutta step of order 4 with the torques held; returns the work of the torques [J]. */
static double advance(double state[STATES], const double torque[WHEELS], double step)
{
    static const double node[4] = {0.0, 0.5, 0.5, 1.0}, weight[4] = {1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0};
    double rate[STATES] = {0.0}, sum[STATES] = {0.0}, work = 0.0;
    for (int stage = 0; stage < 4; ++stage) {
        double inner[STATES], power;
        for (int i = 0; i < STATES; ++i) {
            inner[i] = state[i] + node[stage] * step * rate[i];
        }
        occ_forward(inner, torque, rate);
        occ_power(inner, torque, &power);
        work += weight[stage] * step * power;
        for (int i = 0; i < STATES; ++i) {
            sum[i] += weight[stage] * step * rate[i];
        }
    }
    for (int i = 0; i < STATES; ++i) {
        state[i] += sum[i];
    }
    return work;
}

/* Distance of B from its program [m]. */
static double distance(double t, const double state[STATES])
{
    double position[2];
    const double c = cos(state[2]), s = sin(state[2]);
    occ_program_position(t, MOTION, position);
    return hypot(state[0] + c * POINT[0] - s * POINT[1] - position[0],
                 state[1] + s * POINT[0] + c * POINT[1] - position[1]);
}

static double now(void)
{
    struct timespec time;
    (void)clock_gettime(CLOCK_MONOTONIC, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

/* Time of one call of the controller [ns], the least of several rounds; the result keeps the calls alive. */
static double nanoseconds(const double state[STATES], double *kept)
{
    double least = INFINITY;
    for (int round = 0; round < 5; ++round) {
        const double begin = now();
        for (int i = 0; i < CALLS; ++i) {
            double torque[WHEELS];
            control(1e-6 * i, state, torque);
            *kept += torque[0];
        }
        least = fmin(least, (now() - begin) / CALLS * 1e9);
    }
    return least;
}

int main(void)
{
    double state[STATES] = {0.0}, velocity[2], position[2], torque[WHEELS], residual[2], kept = 0.0;
    double work = 0.0, worst_velocity = 0.0, worst_position = 0.0, peak = 0.0;
    const int ticks = (int)ceil(LAP / PERIOD - 1e-9);
    /* At rest in heading, B on its program. */
    occ_program_position(0.0, MOTION, position);
    occ_program_velocity(0.0, MOTION, velocity);
    state[0] = position[0] - POINT[0];
    state[1] = position[1] - POINT[1];
    state[3] = velocity[0];
    state[4] = velocity[1];
    for (int k = 0; k < ticks; ++k) {
        const double t = k * PERIOD, step = fmin(PERIOD, LAP - t) / SUBSTEPS;
        control(t, state, torque);
        for (int i = 0; i < WHEELS; ++i) {
            peak = fmax(peak, fabs(torque[i]));
        }
        for (int i = 0; i < SUBSTEPS; ++i) {
            work += advance(state, torque, step);
        }
        occ_constraint(t + SUBSTEPS * step, state, POINT, MOTION, residual);
        worst_velocity = fmax(worst_velocity, hypot(residual[0], residual[1]));
        worst_position = fmax(worst_position, distance(t + SUBSTEPS * step, state));
    }
    printf("controller_ns %.1f\n", nanoseconds(state, &kept));
    printf("ticks %d\n", ticks);
    printf("work_J %.9f\n", work);
    printf("velocity_error_m_s %.3e\n", worst_velocity);
    printf("position_error_m %.3e\n", worst_position);
    printf("peak_torque_Nm %.6f\n", peak);
    printf("heading_rad %.9f\n", state[2]);
    return isfinite(kept) ? 0 : 1;
}
