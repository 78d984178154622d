"""What the verbs give on fixed cases, recorded, so that two versions of the project can be compared.

python -m tests.tools.regression make FOLDER                              the fixed blind cases, one hundred
python -m tests.tools.regression record RECORDS --cases FOLDER            one JSON file a case; run again to go on
python -m tests.tools.regression compare RECORDS_A RECORDS_B --sigma 0.1  names, verdicts, parameters and times of both
"""
