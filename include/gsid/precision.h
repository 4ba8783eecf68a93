/* Precision of the library, chosen at build time: double, or float with -DGSID_SINGLE.
 *
 * Every function that sees a gsid_real carries the precision in its linked name (gsid_frf_step_f64,
 * gsid_frf_step_f32), so that headers of one precision and an archive of the other fail to link instead of
 * misreading memory, and so that both archives can stand in one program. Code is written with the plain names.
 */
#ifndef GSID_PRECISION_H
#define GSID_PRECISION_H

#ifdef GSID_SINGLE
#define GSID_R(literal) literal##f
#define GSID_NAME(plain) plain##_f32
#else
#define GSID_R(literal) literal
#define GSID_NAME(plain) plain##_f64
#endif

#ifndef GSID_PLAIN_NAMES /* defined only by the tool that reads these headers for Python */
#define gsid_twiddle_fill GSID_NAME(gsid_twiddle_fill)
#define gsid_lines_fill GSID_NAME(gsid_lines_fill)
#define gsid_amplitude_shape GSID_NAME(gsid_amplitude_shape)
#define gsid_phase_schroeder GSID_NAME(gsid_phase_schroeder)
#define gsid_phase_random GSID_NAME(gsid_phase_random)
#define gsid_multisine_init GSID_NAME(gsid_multisine_init)
#define gsid_multisine_step GSID_NAME(gsid_multisine_step)
#define gsid_multisine_table GSID_NAME(gsid_multisine_table)
#define gsid_multisine_spectrum GSID_NAME(gsid_multisine_spectrum)
#define gsid_sine_init GSID_NAME(gsid_sine_init)
#define gsid_sine_step GSID_NAME(gsid_sine_step)
#define gsid_spectrum_mem_size GSID_NAME(gsid_spectrum_mem_size)
#define gsid_spectrum_init GSID_NAME(gsid_spectrum_init)
#define gsid_spectrum_reset GSID_NAME(gsid_spectrum_reset)
#define gsid_spectrum_step GSID_NAME(gsid_spectrum_step)
#define gsid_spectrum_skip GSID_NAME(gsid_spectrum_skip)
#define gsid_spectrum_result GSID_NAME(gsid_spectrum_result)
#define gsid_spread_mem_size GSID_NAME(gsid_spread_mem_size)
#define gsid_spread_init GSID_NAME(gsid_spread_init)
#define gsid_spread_reset GSID_NAME(gsid_spread_reset)
#define gsid_spread_step GSID_NAME(gsid_spread_step)
#define gsid_spread_skip GSID_NAME(gsid_spread_skip)
#define gsid_spread_finish GSID_NAME(gsid_spread_finish)
#define gsid_spread_line GSID_NAME(gsid_spread_line)
#define gsid_frf_mem_size GSID_NAME(gsid_frf_mem_size)
#define gsid_frf_init GSID_NAME(gsid_frf_init)
#define gsid_frf_spread_mem_size GSID_NAME(gsid_frf_spread_mem_size)
#define gsid_frf_init_spread GSID_NAME(gsid_frf_init_spread)
#define gsid_frf_step GSID_NAME(gsid_frf_step)
#define gsid_frf_skip GSID_NAME(gsid_frf_skip)
#define gsid_frf_finish GSID_NAME(gsid_frf_finish)
#define gsid_guard_init GSID_NAME(gsid_guard_init)
#define gsid_guard_start GSID_NAME(gsid_guard_start)
#define gsid_guard_stop GSID_NAME(gsid_guard_stop)
#define gsid_guard_reset GSID_NAME(gsid_guard_reset)
#define gsid_guard_step GSID_NAME(gsid_guard_step)
#define gsid_frf_add_period GSID_NAME(gsid_frf_add_period)
#define gsid_frf_merge GSID_NAME(gsid_frf_merge)
#define gsid_frf_result GSID_NAME(gsid_frf_result)
#define gsid_distortion_mem_size GSID_NAME(gsid_distortion_mem_size)
#define gsid_distortion_spread_mem_size GSID_NAME(gsid_distortion_spread_mem_size)
#define gsid_distortion_init GSID_NAME(gsid_distortion_init)
#define gsid_distortion_init_spread GSID_NAME(gsid_distortion_init_spread)
#define gsid_distortion_start GSID_NAME(gsid_distortion_start)
#define gsid_distortion_step GSID_NAME(gsid_distortion_step)
#define gsid_distortion_skip GSID_NAME(gsid_distortion_skip)
#define gsid_distortion_add_period GSID_NAME(gsid_distortion_add_period)
#define gsid_distortion_finish GSID_NAME(gsid_distortion_finish)
#define gsid_distortion_result GSID_NAME(gsid_distortion_result)
#define gsid_lsq_mem_size GSID_NAME(gsid_lsq_mem_size)
#define gsid_lsq_init GSID_NAME(gsid_lsq_init)
#define gsid_lsq_reset GSID_NAME(gsid_lsq_reset)
#define gsid_lsq_add GSID_NAME(gsid_lsq_add)
#define gsid_lsq_add_block GSID_NAME(gsid_lsq_add_block)
#define gsid_lsq_solve GSID_NAME(gsid_lsq_solve)
#define gsid_lsq_solve_normal GSID_NAME(gsid_lsq_solve_normal)
#define gsid_lsq_covariance GSID_NAME(gsid_lsq_covariance)
#define gsid_rational_init GSID_NAME(gsid_rational_init)
#define gsid_rational_variable GSID_NAME(gsid_rational_variable)
#define gsid_rational_eval GSID_NAME(gsid_rational_eval)
#define gsid_rational_held GSID_NAME(gsid_rational_held)
#define gsid_rational_gradient GSID_NAME(gsid_rational_gradient)
#define gsid_rational_is_stable GSID_NAME(gsid_rational_is_stable)
#define gsid_estimate_mem_size GSID_NAME(gsid_estimate_mem_size)
#define gsid_estimate_cost GSID_NAME(gsid_estimate_cost)
#define gsid_estimate_iwls GSID_NAME(gsid_estimate_iwls)
#define gsid_estimate_ml GSID_NAME(gsid_estimate_ml)
#define gsid_estimate_covariance GSID_NAME(gsid_estimate_covariance)
#define gsid_linear_state GSID_NAME(gsid_linear_state)
#define gsid_linear_add GSID_NAME(gsid_linear_add)
#define gsid_linear_slope GSID_NAME(gsid_linear_slope)
#define gsid_linear_delay GSID_NAME(gsid_linear_delay)
#define gsid_plant_mem_size GSID_NAME(gsid_plant_mem_size)
#define gsid_plant_init GSID_NAME(gsid_plant_init)
#define gsid_plant_update GSID_NAME(gsid_plant_update)
#define gsid_plant_reset GSID_NAME(gsid_plant_reset)
#define gsid_plant_step GSID_NAME(gsid_plant_step)
#define gsid_plant_periodic GSID_NAME(gsid_plant_periodic)
#define gsid_expression_effect GSID_NAME(gsid_expression_effect)
#define gsid_table_slopes GSID_NAME(gsid_table_slopes)
#define gsid_table_effect GSID_NAME(gsid_table_effect)
#define gsid_catalogue GSID_NAME(gsid_catalogue)
#define gsid_n_catalogue GSID_NAME(gsid_n_catalogue)
#define gsid_catalogue_find GSID_NAME(gsid_catalogue_find)
#endif

#endif
