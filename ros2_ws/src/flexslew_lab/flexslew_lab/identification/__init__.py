"""What a bench is made of, from its log alone.

Offers: files, files.columns, files.csv_file, identification, modal.modal_fit, modal.modes,
modal.parameter_groups, model_file, next_plan, page, physical_fit, records.file_experiment,
records.hold, records.measurements, records.record, responses.frequency_response, responses.frf_fit,
responses.response_page, responses.universal.
"""
