"""What a bench is made of, from its log alone.

Offers: file_experiment, files, files.columns, files.csv_file, frequency_response, frf_fit,
identification, measurements, modal_fit, model_file, modes, next_plan, page, parameter_groups,
physical_fit, record, response_page, universal.
"""
